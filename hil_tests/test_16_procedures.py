"""What a station has a disarmed robot do: calibrate its gyro, turn one wheel; and take it back."""

from __future__ import annotations

import math
import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from hil_tests.ground_station import GroundStation, mavlink
from hil_tests.rig import PATIENT_S
from hil_tests.test_14_imu import robot_file
from robotctl.app.supervision.stack import TELEMETRY
from robotctl.dialect import additions
from robotctl.messages.control import SafetyState

CALIBRATE, TEST = mavlink.MAV_CMD_PREFLIGHT_CALIBRATION, mavlink.MAV_CMD_DO_MOTOR_TEST
ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
IN_PROGRESS, ACCEPTED = mavlink.MAV_RESULT_IN_PROGRESS, mavlink.MAV_RESULT_ACCEPTED
CHANGE_RAD_S = 0.05
RADIUS_M, TRACK_M = 0.05, 0.3


def result(station: GroundStation, number: int) -> int:
    """Wait for the acknowledgement that is no progress; return its result."""
    return station.wait(
        "COMMAND_ACK", lambda ack: ack.command == number and ack.result != IN_PROGRESS
    ).result


def begin(station: GroundStation, number: int, *params: float) -> None:
    """Send a command, and wait until it is under way."""
    station.wait("HEARTBEAT")
    assert station.command(number, *params) == IN_PROGRESS


def ends_within(station: GroundStation, seconds: float) -> None:
    """Wait until the motors are off."""
    station.rig.wait_for_state(SafetyState.STANDBY, seconds)
    station.rig.at_rest()


def test_a_gyro_whose_bias_has_changed_is_calibrated(
    make_station: Callable[..., GroundStation], tmp_path: Path
) -> None:
    station = make_station(robot=robot_file(tmp_path))
    rig = station.rig
    bias = lambda: rig.control.imu.bias_rad_s[2]  # noqa: E731
    rig.wait(lambda: rig.control.imu is not None and bias() != 0.0, PATIENT_S, "a bias")
    before = bias()
    rig.inject(f"gyro_biased rate={CHANGE_RAD_S}")
    progress = []
    begin(station, CALIBRATE, 1.0)
    while (ack := station.wait("COMMAND_ACK")).result == IN_PROGRESS:
        progress.append(ack.progress)
    assert ack.result == ACCEPTED
    assert progress == sorted(progress)
    assert progress[-1] >= 80
    rig.wait(lambda: abs(bias() - before - CHANGE_RAD_S) < 0.004, 1.0, "the new bias is used")
    assert station.command(CALIBRATE, 0.0, 1.0) == mavlink.MAV_RESULT_UNSUPPORTED
    assert station.command(ARM, 1) == ACCEPTED
    assert station.command(CALIBRATE, 1.0) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED


def test_an_emergency_stop_ends_a_motor_test_and_latches(station: GroundStation) -> None:
    begin(station, TEST, 1, 0, 15.0, 5.0, 1)
    station.command(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1)
    station.rig.wait_for_state(SafetyState.EMERGENCY_STOP, 0.5)
    assert result(station, TEST) == mavlink.MAV_RESULT_FAILED
    station.rig.at_rest()
    assert station.command(TEST, 1, 0, 15.0, 1.0, 1) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED


def test_a_reversed_encoder_is_found_by_it(station: GroundStation) -> None:
    station.rig.inject("encoder_reversed wheel=left")
    begin(station, TEST, 1, 0, 100.0, 5.0, 1)
    state = station.rig.wait_for_state(SafetyState.FAULT)
    assert "left encoder reversed" in state.reason
    assert result(station, TEST) == mavlink.MAV_RESULT_FAILED
    station.rig.at_rest()


def test_a_place_is_driven_to_in_reverse(station: GroundStation) -> None:
    rig = station.rig
    reverse, set_mode = mavlink.MAV_CMD_DO_SET_REVERSE, mavlink.MAV_CMD_DO_SET_MODE
    assert station.command(reverse, 1) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    assert station.command(ARM, 1) == ACCEPTED
    guided = (mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, 15)
    assert station.command(set_mode, *guided) == ACCEPTED
    assert station.command(reverse, 1) == ACCEPTED
    before = rig.fresh_truth()
    station.drive_to(before.x_m - 1.0, before.y_m)
    rig.wait(lambda: rig.navigation.goal_reached is not None, PATIENT_S, "it has arrived")
    after = rig.fresh_truth()
    assert abs(after.x_m - before.x_m + 1.0) < 0.1
    assert abs(after.theta_rad - before.theta_rad) < 0.2, "it has not turned round"


def is_ended_at_once(station: GroundStation, end: Callable[[GroundStation], None]) -> None:
    """Let a motor turn and assert that `end` stops it."""
    station.command(TEST)  # asks for nothing: the next one is no late copy of that of another test
    begin(station, TEST, 2, 0, 15.0, 5.0, 1)
    station.rig.wait_for_state(SafetyState.MOTOR_TEST)
    end(station)
    ends_within(station, 0.5)
    station.rig.assert_safe()


def kill_telemetry(station: GroundStation) -> None:
    station.rig.kill(TELEMETRY, signal.SIGKILL)


def hang_up(station: GroundStation) -> None:
    station.link.close()


@pytest.mark.parametrize("end", [kill_telemetry, hang_up])
def test_without_its_station_a_motor_test_ends_at_once(
    station: GroundStation, end: Callable[[GroundStation], None]
) -> None:
    is_ended_at_once(station, end)


@pytest.mark.parametrize(("motor", "throttle"), [(1, 12.0), (2, 12.0), (1, -12.0)])
def test_that_wheel_turns_the_robot_that_way(
    lasting_station: GroundStation, motor: int, throttle: float
) -> None:
    station = lasting_station
    rig = station.rig
    before = rig.fresh_truth()
    begin(station, TEST, motor, 0, throttle, 1.5, 1)
    beat = station.wait("HEARTBEAT")
    assert beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED, "its motors are on"
    assert result(station, TEST) == ACCEPTED
    ends_within(station, 1.0)
    turned_rad = rig.fresh_truth().theta_rad - before.theta_rad
    # About the other wheel: the left one forwards to the right.
    side = -1.0 if motor == 1 else 1.0
    assert 0.1 < turned_rad * side * math.copysign(1.0, throttle) < 0.2 * 1.5 / TRACK_M
    rig.assert_safe()


def test_arming_ends_a_motor_test(lasting_station: GroundStation) -> None:
    station = lasting_station
    begin(station, TEST, 1, 0, 15.0, 5.0, 1)
    assert station.command(ARM, 1) == ACCEPTED
    station.rig.wait_for_state(SafetyState.ARMED)
    station.rig.at_rest()
    begin_later = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    station.link.mav.command_long_send(1, 1, TEST, 0, 1, 0, 15.0, 1.0, 1, 0, 0)
    station.wait("COMMAND_ACK", lambda ack: (ack.command, ack.result) == (TEST, begin_later))


def cancel(station: GroundStation) -> None:
    station.link.mav.send(additions.MAVLink_command_cancel_message(1, 1, TEST))
    assert result(station, TEST) == additions.MAV_RESULT_CANCELLED


def disarm(station: GroundStation) -> None:
    assert station.command(ARM, 0) == ACCEPTED


def fall_silent(station: GroundStation) -> None:
    end_s = time.monotonic() + 1.6
    station.rig.wait(lambda: time.monotonic() > end_s, 2.0, "no heartbeat is sent")


@pytest.mark.parametrize("end", [cancel, disarm, fall_silent])
def test_what_ends_a_motor_test_ends_it_at_once(
    lasting_station: GroundStation, end: Callable[[GroundStation], None]
) -> None:
    is_ended_at_once(lasting_station, end)
