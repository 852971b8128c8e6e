"""Heartbeat: state and mode of the robot."""

import pytest
from pymavlink.dialects.v20 import common

from robotctl.messages.control import (
    Mode,
    SafetyState,
)


def test_heartbeat_says_ardupilot_rover_and_comes_once_a_second(bench):
    bench.run(10.0)
    beats = bench.messages("HEARTBEAT")
    assert len(beats) == 10
    assert beats[0].type == common.MAV_TYPE_GROUND_ROVER
    assert beats[0].autopilot == common.MAV_AUTOPILOT_ARDUPILOTMEGA
    assert beats[0].base_mode & common.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    assert beats[0].get_srcSystem() == 1


@pytest.mark.parametrize(
    ("state", "mav_state", "armed"),
    [
        (SafetyState.BOOT, common.MAV_STATE_BOOT, False),
        (SafetyState.STANDBY, common.MAV_STATE_STANDBY, False),
        (SafetyState.ARMED, common.MAV_STATE_ACTIVE, True),
        (SafetyState.DRIVING, common.MAV_STATE_ACTIVE, True),
        (SafetyState.FAULT, common.MAV_STATE_CRITICAL, False),
        (SafetyState.EMERGENCY_STOP, common.MAV_STATE_EMERGENCY, False),
    ],
)
def test_each_safety_state_has_its_mav_state_and_armed_flag(bench, state, mav_state, armed):
    bench.step(bench.control(state=state))
    beat = bench.messages("HEARTBEAT")[0]
    assert beat.system_status == mav_state
    assert bool(beat.base_mode & common.MAV_MODE_FLAG_SAFETY_ARMED) == armed


def test_a_heartbeat_goes_out_at_once_when_the_robot_is_armed_or_changes_its_mode(bench):
    bench.step(bench.control(state=SafetyState.STANDBY), bench.navigation(mode=Mode.HOLD))
    bench.take()
    for state, mode in (
        (SafetyState.ARMED, Mode.HOLD),
        (SafetyState.ARMED, Mode.AUTO),
        (SafetyState.FAULT, Mode.HOLD),
    ):
        for count in (1, 0, 0):
            bench.step(bench.control(state=state), bench.navigation(mode=mode))
            beats = bench.messages("HEARTBEAT")
            assert len(beats) == count
            armed = [bool(beat.base_mode & common.MAV_MODE_FLAG_SAFETY_ARMED) for beat in beats]
            assert armed == [state is SafetyState.ARMED] * count
            assert [beat.custom_mode for beat in beats] == [mode] * count


def test_half_a_second_after_the_last_word_of_control_the_state_is_critical(bench):
    bench.run(1.5, state=SafetyState.DRIVING)
    bench.take()
    silent_ns, beats = bench.now_ns, []
    while not (beats and beats[-1].system_status == common.MAV_STATE_CRITICAL):
        bench.step()
        beats += bench.messages("HEARTBEAT")
    assert 0.5e9 < bench.now_ns - silent_ns <= 0.54e9
    assert not beats[-1].base_mode & common.MAV_MODE_FLAG_SAFETY_ARMED


@pytest.mark.parametrize(
    ("mode", "number"),
    [(Mode.MANUAL, 0), (Mode.HOLD, 4), (Mode.AUTO, 10), (Mode.RTL, 11), (Mode.GUIDED, 15)],
)
def test_each_mode_has_its_ardurover_number(bench, mode, number):
    bench.step(bench.navigation(mode=mode))
    assert bench.messages("HEARTBEAT")[0].custom_mode == number


def test_before_control_is_heard_the_state_is_boot_and_no_pose_is_sent(bench):
    for _ in range(100):
        bench.step()
    sent = bench.take()
    assert {message.get_type() for message, _ in sent} == {"HEARTBEAT", "SYS_STATUS", "SYSTEM_TIME"}
    assert sent[0][0].system_status == common.MAV_STATE_BOOT


def test_when_control_falls_silent_the_state_is_critical_disarmed_and_the_pose_stops(bench):
    bench.run(1.0, state=SafetyState.DRIVING)
    for _ in range(60):
        bench.step()
    bench.take()
    for _ in range(60):
        bench.step()
    sent = bench.take()
    beat = next(message for message, _ in sent if message.get_type() == "HEARTBEAT")
    assert beat.system_status == common.MAV_STATE_CRITICAL
    assert not beat.base_mode & common.MAV_MODE_FLAG_SAFETY_ARMED
    names = {message.get_type() for message, _ in sent}
    assert names - {"CURRENT_EVENT_SEQUENCE"} == {"HEARTBEAT", "SYS_STATUS", "SYSTEM_TIME"}
    status = next(message for message, _ in sent if message.get_type() == "SYS_STATUS")
    assert status.onboard_control_sensors_health == common.MAV_SYS_STATUS_GEOFENCE


def test_when_navigation_falls_silent_the_mode_is_hold(bench):
    bench.step(bench.navigation(mode=Mode.AUTO))
    bench.take()
    bench.run(2.5)
    assert bench.messages("HEARTBEAT")[-1].custom_mode == Mode.HOLD
