"""Faults of the host: whatever happens to its processes, the wheels stop and stay stopped."""

from __future__ import annotations

import resource
import signal
import time
from collections.abc import Callable
from contextlib import nullcontext

import can
import canopen
import pytest

from hil_tests.bus_tool import (
    COMMAND,
    DRIVE,
    EMCY_COMMAND_TIMEOUT,
    EMCY_DRIVE,
    POWER,
    SONAR,
    enabled,
)
from hil_tests.faulty_control import COLLECT, HANG, PAUSE_S, SPIN
from hil_tests.faulty_navigation import LEAK
from hil_tests.floods import flood
from hil_tests.ground_station import GroundStation, mavlink
from hil_tests.rig import GUEST_TIME, PATIENT_S, Rig
from robotctl.app.supervision.stack import CONTROL, NAVIGATION, RECORDER, TELEMETRY
from robotctl.core.station_watch import PRESENCE_MAX_AGE_NS
from robotctl.messages.control import Mode, SafetyState
from robotctl.messages.faults import FaultCode
from robotctl.planning.behave.stalls import LONGEST_NS

React = Callable[[str, float], None]

RESOLUTION_MS = 1.0
"""The drive looks at its time-outs each millisecond."""

BUS_MS = 4.0
"""Frames wait for the bus, and EMCY for the frames before it."""

CANNOT_BE_STORED_IN_THIS_STATE = 0x08000022
"""SDO abort code of CiA 301, table 22."""

ROLLS_M = 0.12
"""From 0.5 m/s: the drive's time-out, and the way that its brake needs."""


def reaction_ms(rig: Rig, messages: list) -> float:
    """Return the time from the last command to the drive's EMCY, by the bus's own stamps."""
    emergency = messages[-1]
    assert int.from_bytes(emergency.data[:2], "little") == EMCY_COMMAND_TIMEOUT
    last_s = max(m.timestamp for m in messages if m.arbitration_id == COMMAND)
    return 1000 * (emergency.timestamp - last_s)


def assert_in_time(rig: Rig, taken_ms: float) -> None:
    """Assert that the drive kept its time-out."""
    limit_ms = rig.config.safety.command_timeout_ms
    assert limit_ms - RESOLUTION_MS <= taken_ms <= limit_ms + RESOLUTION_MS + BUS_MS


def assert_stays(rig: Rig) -> None:
    """Assert that commands move nothing until the robot has been armed, and then do."""
    rig.at_rest()
    before = rig.fresh_truth()
    rig.drive(0.4, 0.0, 0.7)
    assert rig.fresh_truth().distance_m - before.distance_m < 1e-3
    rig.arm()
    rig.drive(0.3, 0.0, 1.0)
    assert rig.fresh_truth().distance_m - before.distance_m > 0.1


FROZEN = "host: SIGSTOP"
IN_A_TICK = {
    "host: hangs in a step": HANG,
    "host: busy loop in a step": SPIN,
    "host: long garbage collection": COLLECT,
}
COMPUTING = {SPIN, COLLECT}
"""What takes a processor to itself: two at once leave nothing to the loops of other robots."""


@pytest.mark.parametrize("fault", [FROZEN, *IN_A_TICK])
def test_a_host_that_falls_silent_is_stopped_by_the_drive_and_waits_for_arming(
    rig: Rig, fault: str, reaction: React
) -> None:
    computing = IN_A_TICK.get(fault) in COMPUTING
    if GUEST_TIME == "virtual" and computing:
        pytest.skip("virtual time: computing takes none")
    rig.start(CONTROL, "hil_tests.faulty_control")
    rig.arm()
    with flood() if computing else nullcontext():
        rig.drive(0.5, 0.0, 1.0)
        messages = rig.heard(0.05)
        rig.at_any_moment()
        rig.send_signal(CONTROL, signal.SIGSTOP if fault == FROZEN else IN_A_TICK[fault])
        messages += rig.heard_until(EMCY_DRIVE, 3.0)
        time.sleep(PAUSE_S if computing else 0.0)
    if fault == FROZEN:
        rig.send_signal(CONTROL, signal.SIGCONT)
    taken_ms = reaction_ms(rig, messages)
    reaction(fault, taken_ms)
    assert_in_time(rig, taken_ms)
    state = rig.wait_for_state(SafetyState.FAULT, 3.0)
    assert state.fault == FaultCode.CONTROL_HELD_UP, state.reason
    assert any(state.reason in notice for notice in rig.notices)
    assert_stays(rig)


def test_a_killed_host_is_stopped_by_the_drive(armed: Rig, reaction: React) -> None:
    armed.drive(0.5, 0.0, 1.0)
    messages = armed.heard(0.05)
    armed.at_any_moment()
    armed.kill(CONTROL, signal.SIGKILL)
    messages += armed.heard_until(EMCY_DRIVE, 3.0)
    taken_ms = reaction_ms(armed, messages)
    reaction("host: SIGKILL", taken_ms)
    assert_in_time(armed, taken_ms)
    armed.at_rest()


FOREIGN_WRITES = {
    "command time-out": (DRIVE, 0x2000, 2000, 2),
    "current limit": (DRIVE, 0x2003, 200_000, 4),
    "heartbeat": (DRIVE, 0x1017, 0, 2),
    "ring period": (SONAR, 0x2201, 240, 2),
    "critical limit": (POWER, 0x2301, 0, 2),
}


def test_a_strangers_writes_are_refused_and_a_killed_host_is_stopped_as_before(armed: Rig) -> None:
    armed.drive(0.5, 0.0, 1.0)
    for name, write in FOREIGN_WRITES.items():
        with pytest.raises(canopen.SdoAbortedError) as refusal:
            armed.write_object(*write)
        assert refusal.value.code == CANNOT_BE_STORED_IN_THIS_STATE, name
        armed.drive(0.4, 0.8, 0.5)
    armed.drive(0.5, 0.0, 1.0)
    assert armed.control.state == SafetyState.DRIVING, armed.control.reason
    messages = armed.heard(0.05)
    armed.kill(CONTROL, signal.SIGKILL)
    killed = armed.fresh_truth()
    messages += armed.heard_until(EMCY_DRIVE, 3.0)
    assert_in_time(armed, reaction_ms(armed, messages))
    armed.at_rest()
    assert armed.truth.distance_m - killed.distance_m < ROLLS_M


def test_a_time_out_that_a_stranger_writes_before_arming_is_said_and_put_right(rig: Rig) -> None:
    rig.start()
    rig.wait_for_state(SafetyState.STANDBY)
    rig.write_object(DRIVE, 0x2000, 2000, 2)
    problem = "drive (node 1): command time-out reads back 2000 ms, wanted 90 ms: it was changed"
    rig.wait(
        lambda: f"not ready: {problem}" in rig.notices,
        PATIENT_S,
        "it is said",
    )
    rig.wait_for_state(SafetyState.STANDBY)
    rig.arm()
    rig.drive(0.5, 0.0, 1.0)
    messages = rig.heard(0.05)
    rig.kill(CONTROL, signal.SIGKILL)
    messages += rig.heard_until(EMCY_DRIVE, 3.0)
    assert_in_time(rig, reaction_ms(rig, messages))


HELD_UP_MS = 500.0
"""Navigation has no priority; where it was held up for longer it holds for that."""

EXPIRES_MS = 200.0
"""A velocity that navigation sends is good for four of its periods."""

STATE_MS = 20.0
"""Between two states that control publishes."""


def at_rest_ms(rig: Rig) -> float:
    """Return how long after the last velocity command the set-point is zero, at the latest [ms].

    The command expires, and the limiter brings the greatest velocity to zero: the acceleration
    ends if there is one, then the braking begins and ends.
    """
    limits = rig.config.limits
    straight_s = limits.v_max_m_s / limits.a_max_m_s2 + 2 * limits.a_max_m_s2 / limits.jerk_max_m_s3
    turning_s = (
        limits.omega_max_rad_s / limits.alpha_max_rad_s2
        + 2 * limits.alpha_max_rad_s2 / limits.angular_jerk_max_rad_s3
    )
    return EXPIRES_MS + 1000 * max(straight_s, turning_s)


def on_mission(rig: Rig, navigation: str = NAVIGATION) -> None:
    """Start the whole stack, arm, and drive in mode AUTO."""
    for module in (CONTROL, TELEMETRY, RECORDER):
        rig.start(module)
    rig.start(NAVIGATION, navigation)
    rig.arm()
    navigation_drives(rig)


def navigation_drives(rig: Rig) -> None:
    """Let the armed robot drive in mode AUTO."""
    rig.wait(lambda: rig.navigation, PATIENT_S, "navigation is there")
    rig.prefer(NAVIGATION)
    rig.set_mode(Mode.AUTO)

    def drives() -> bool:
        state = rig.control.state
        assert state in {SafetyState.ARMED, SafetyState.DRIVING}, rig.told()
        return rig.control.v_m_s > 0.2

    rig.wait(drives, PATIENT_S, "the mission drives")


@pytest.mark.parametrize("fault", ["killed", "frozen for long", "out of memory"])
def test_without_navigation_the_robot_stops_and_a_new_navigation_does_not_drive_on(
    mission_rig: Rig, fault: str, reaction: React
) -> None:
    rig = mission_rig
    on_mission(rig, "hil_tests.faulty_navigation")
    rig.heard(0.02)
    rig.at_any_moment()
    if fault == "out of memory":
        rig.send_signal(NAVIGATION, LEAK)
        rig.wait(lambda: not rig.is_running(NAVIGATION), PATIENT_S, "its memory is used up")
    if fault == "killed":
        rig.kill(NAVIGATION, signal.SIGKILL)
    elif fault == "frozen for long":
        rig.send_signal(NAVIGATION, signal.SIGSTOP)
    comes_to_rest(rig, f"navigation {fault}", reaction)
    before = rig.fresh_truth()
    rig.navigation = None
    if fault == "frozen for long":
        time.sleep(LONGEST_NS / 1e9)
        rig.send_signal(NAVIGATION, signal.SIGCONT)
    else:
        rig.start(NAVIGATION)
    rig.wait(lambda: rig.navigation, PATIENT_S, "navigation is back")
    rig.heard(1.0)
    rig.listen()
    assert rig.navigation.mode == Mode.HOLD
    if fault == "frozen for long":
        assert any("hold: navigation was held up (kept" in notice for notice in rig.notices)
    assert rig.fresh_truth().distance_m - before.distance_m < 1e-3
    navigation_drives(rig)


def comes_to_rest(rig: Rig, fault: str, reaction: React) -> None:
    """Assert that the robot is at rest in time behind navigation's last step, and stays armed."""
    rig.wait(lambda: rig.control.v_ref_m_s == 0.0, 3.0, "set-points expire")
    taken_ms = (rig.control.stamp_ns - rig.navigation.stamp_ns) / 1e6
    reaction(fault, taken_ms)
    assert taken_ms <= at_rest_ms(rig) + 2 * STATE_MS
    rig.at_rest()
    rig.wait_for_state(SafetyState.ARMED, 1.0)


def test_a_navigation_frozen_for_a_moment_goes_on_by_itself_and_says_so(
    mission_rig: Rig, reaction: React
) -> None:
    rig = mission_rig
    on_mission(rig)
    rig.heard(0.02)
    rig.at_any_moment()
    rig.send_signal(NAVIGATION, signal.SIGSTOP)
    comes_to_rest(rig, "navigation frozen", reaction)
    rig.notices.clear()
    rig.send_signal(NAVIGATION, signal.SIGCONT)
    rig.wait(lambda: rig.navigation.message.startswith("waits: "), 2.0, "it says why it stands")
    rig.wait(lambda: rig.control.v_m_s > 0.2, PATIENT_S, "it goes on")
    assert rig.navigation.mode == Mode.AUTO
    rig.wait(
        lambda: any(
            each.startswith("navigation was held up (kept from the processor, or stopped) for")
            and each.endswith("; the robot goes on")
            for each in rig.notices
        ),
        1.0,
        "it is told",
    )


@pytest.mark.parametrize("fault", ["ground station silent", "telemetry killed"])
def test_a_robot_that_must_have_a_ground_station_stops_without_it(
    make_station: Callable[..., GroundStation], fault: str, reaction: React
) -> None:
    station = make_station(override="mavlink.hold_without_gcs=true")
    rig = station.rig
    assert station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == mavlink.MAV_RESULT_ACCEPTED
    mode = (mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, Mode.GUIDED)
    assert station.command(mavlink.MAV_CMD_DO_SET_MODE, *mode) == mavlink.MAV_RESULT_ACCEPTED
    beaten_ns = time.monotonic_ns()
    station.drive_to(5.5, 2.0)
    rig.wait(lambda: rig.control.v_m_s > 0.2, PATIENT_S, "it drives")
    limit_ms = 1e-6 * PRESENCE_MAX_AGE_NS
    if fault == "telemetry killed":
        rig.kill(TELEMETRY)
        beaten_ns = time.monotonic_ns()
    else:
        limit_ms += 1000 * rig.config.mavlink.gcs_timeout_s
    rig.wait(lambda: rig.navigation.mode == Mode.HOLD, PATIENT_S, "it holds")
    taken_ms = (rig.navigation.stamp_ns - beaten_ns) / 1e6
    assert rig.navigation.message == "hold: no ground station is connected"
    reaction(fault, taken_ms)
    assert taken_ms <= limit_ms + HELD_UP_MS
    rig.at_rest()
    before = rig.fresh_truth()
    rig.ask_for_mode(Mode.GUIDED)
    refused = "refused: no ground station is connected"
    rig.wait(lambda: rig.navigation.message == refused, PATIENT_S, "GUIDED is refused")
    assert rig.navigation.mode == Mode.HOLD
    assert rig.fresh_truth().distance_m - before.distance_m < 1e-3


def test_a_full_disk_is_said_and_stops_nothing_nor_does_the_end_of_recorder_and_telemetry(
    mission_rig: Rig,
) -> None:
    rig = mission_rig
    on_mission(rig)
    resource.prlimit(rig.pid(RECORDER), resource.RLIMIT_FSIZE, (4096, 4096))
    rig.wait(
        lambda: any("logging stopped" in notice for notice in rig.notices), PATIENT_S, "it is said"
    )
    drives_on(rig)
    assert rig.is_running(RECORDER)
    for module in (RECORDER, TELEMETRY):
        rig.kill(module, signal.SIGKILL)
        drives_on(rig)


def drives_on(rig: Rig) -> None:
    """Assert that the robot drives for a second, commanded all the time."""
    before = rig.fresh_truth()
    commands = [enabled(m) for m in rig.heard(1.0) if m.arbitration_id == COMMAND]
    assert commands
    assert all(commands)
    assert rig.fresh_truth().distance_m - before.distance_m > 0.2
    assert rig.control.state == SafetyState.DRIVING


@pytest.mark.parametrize("command", [2, 128, 129, 130])
def test_nmt_of_a_stranger_stops_the_robot_and_is_named(lasting: Rig, command: int) -> None:
    lasting.drive(0.5, 0.0, 1.0)
    lasting.observer.send(
        can.Message(arbitration_id=0x000, data=bytes((command, DRIVE)), is_extended_id=False)
    )
    state = lasting.wait_for_state(SafetyState.FAULT, 1.0)
    restarted = command > 128 and state.fault == FaultCode.NODE_RESTARTED
    assert state.fault == FaultCode.NODE_PUT_OUT or restarted, state.reason
    lasting.at_rest()
    lasting.wait(
        lambda: not any(node.problem for node in lasting.control.nodes), PATIENT_S, "nodes are back"
    )
    assert_stays(lasting)
