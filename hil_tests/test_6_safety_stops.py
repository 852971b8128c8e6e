"""Bring-up, sixth step: whoever dies, the wheels stop, and nothing resumes by itself."""

import signal
import time
from collections.abc import Callable

import can
import cantools
import pytest

from hil_tests.bus_tool import COMMAND, EMERGENCY_STOP, enabled
from hil_tests.emergency_stop import SOURCES, assert_latched
from hil_tests.ground_station import GroundStation, mavlink
from hil_tests.rig import PATIENT_S, Rig
from robotctl.app.supervision.stack import CONTROL
from robotctl.config.robot_file import config_directory
from robotctl.messages.control import SafetyState
from robotctl.messages.faults import FaultCode


def test_a_host_that_comes_back_does_not_move_before_it_is_armed(armed: Rig) -> None:
    armed.drive(0.5, 0.0, 1.0)
    armed.kill(CONTROL, signal.SIGKILL)
    armed.at_rest()
    armed.control = None
    armed.start()
    armed.wait_for_state(SafetyState.STANDBY)
    before = armed.fresh_truth()
    armed.drive(0.5, 0.0, 1.0)
    assert armed.truth.distance_m - before.distance_m < 1e-3
    armed.arm()
    armed.drive(0.3, 0.0, 1.0)
    assert armed.fresh_truth().distance_m - before.distance_m > 0.1


def test_on_sigterm_the_host_disables_the_motors_before_it_ends(armed: Rig) -> None:
    armed.drive(0.5, 0.0, 1.0)
    messages = armed.heard(0.05)
    assert armed.kill(CONTROL, signal.SIGTERM) == 0
    messages += armed.heard(0.2, before=True)
    enable = [enabled(m) for m in messages if m.arbitration_id == COMMAND]
    assert enable[0] is True
    assert enable[-1] is False
    assert enable == sorted(enable, reverse=True)
    armed.at_rest()


def test_when_the_firmware_dies_the_host_stops_and_waits_to_be_armed_again(armed: Rig) -> None:
    armed.drive(0.4, 0.0, 1.0)
    armed.kill("firmware", signal.SIGKILL)
    state = armed.wait_for_state(SafetyState.FAULT, 2.0)
    gone = FaultCode.WHEELS_STALE, FaultCode.BUS_OFF, FaultCode.BUS_DOWN
    assert state.fault in gone, state.reason
    armed.start_firmware()
    armed.wait(
        lambda: not any(node.problem for node in armed.control.nodes), PATIENT_S, "nodes are back"
    )
    before = armed.fresh_truth()
    armed.drive(0.4, 0.0, 1.0)
    assert armed.control.state == SafetyState.FAULT
    assert armed.truth.distance_m - before.distance_m < 1e-3
    armed.arm()
    armed.drive(0.3, 0.0, 1.0)
    assert armed.fresh_truth().distance_m - before.distance_m > 0.1


LAG_RAD, SETTLED_RAD = 0.05, 0.01
"""A servo that is so far behind its command is on its way; one that moves less stands [rad]."""
WIRE = cantools.database.load_file(config_directory() / "robot.dbc")


def steering_rad(messages: list[can.Message], name: str) -> list[float]:
    """Return the steering angles in the frames of one kind [rad]."""
    kind = WIRE.get_message_by_name(name)
    return [
        kind.decode(message.data)["SteeringAngle"]
        for message in messages
        if message.arbitration_id == kind.frame_id
    ]


@pytest.mark.parametrize("robot", ["tricycle", "ackermann"])
def test_a_stop_while_it_steers_leaves_the_steering_where_it_is(
    make_rig: Callable[..., Rig], robot: str
) -> None:
    rig = make_rig(robot=robot)
    rig.start_firmware()
    rig.start()
    rig.arm()
    rig.drive(0.4, 0.5, 1.0)
    rig.heard(0.01)
    rig.drive(0.4, -0.5, 0.15)
    asked_ns = time.monotonic_ns()
    SOURCES["SIGUSR1"](rig)
    rig.wait(lambda: rig.truth.power_off_ns > asked_ns, 2.0, "the wheels lose their power")
    messages = rig.heard(0.05, before=True)
    held_rad = steering_rad(rig.heard(0.5), "DriveStatus")
    assert min(steering_rad(messages, "MotorCommand")) < held_rad[0] - LAG_RAD, "it does not steer"
    assert max(held_rad) - min(held_rad) < SETTLED_RAD
    rig.at_rest()


@pytest.mark.parametrize("source", list(SOURCES))
def test_an_emergency_stop_while_the_robot_starts(rig: Rig, source: str) -> None:
    rig.start()
    rig.wait(lambda: rig.control is not None, PATIENT_S, "the control process is there")
    SOURCES[source](rig)
    rig.wait_for_state(SafetyState.EMERGENCY_STOP, 1.0)
    rig.wait(
        lambda: not any(node.problem for node in rig.control.nodes), PATIENT_S, "nodes are ready"
    )
    assert_latched(rig)


def test_an_emergency_stop_by_the_ground_station_latches_and_arming_from_there_ends_it(
    station: GroundStation, reaction: Callable[[str, float], None]
) -> None:
    rig = station.rig
    assert station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == mavlink.MAV_RESULT_ACCEPTED
    rig.wait_for_state(SafetyState.ARMED)
    rig.drive(0.4, 0.8, 0.5)
    rig.heard(0.05)
    rig.at_any_moment()
    asked_s = time.time()
    station.command(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1)
    heard_s = rig.heard_until(EMERGENCY_STOP, 1.0)[-1].timestamp
    taken_ms = 1000 * (heard_s - asked_s)
    reaction("emergency stop by MAVLink: on the bus", taken_ms)
    assert taken_ms < 100.0
    rig.wait_for_state(SafetyState.EMERGENCY_STOP, 1.0)
    beat = station.wait("HEARTBEAT", lambda b: b.system_status == mavlink.MAV_STATE_EMERGENCY)
    assert not beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    rig.at_rest()

    def armed() -> bool:  # a request within a second of the last one may be a late copy of it
        result = station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        rig.heard(0.2)
        return result == mavlink.MAV_RESULT_ACCEPTED

    rig.wait(armed, PATIENT_S, "arming is accepted")
    rig.wait_for_state(SafetyState.ARMED)


def test_an_emergency_stop_frame_of_anybody_stops_drive_and_host_and_latches(lasting: Rig) -> None:
    lasting.drive(0.5, 0.0, 1.0)
    lasting.observer.send(
        can.Message(arbitration_id=EMERGENCY_STOP, data=b"\x05", is_extended_id=False)
    )
    lasting.wait_for_state(SafetyState.EMERGENCY_STOP, 1.0)
    lasting.at_rest()
    before = lasting.fresh_truth()
    lasting.drive(0.5, 0.0, 1.0)
    assert lasting.control.state == SafetyState.EMERGENCY_STOP
    assert lasting.truth.distance_m - before.distance_m < 1e-3


def test_an_emergency_stop_by_the_operator_reaches_the_bus_and_only_arming_ends_it(
    lasting: Rig,
) -> None:
    lasting.drive(0.5, 0.0, 1.0)
    lasting.heard(0.05)
    lasting.emergency_stop()
    assert lasting.heard_until(EMERGENCY_STOP, 1.0)[-1].arbitration_id == EMERGENCY_STOP
    lasting.wait_for_state(SafetyState.EMERGENCY_STOP, 1.0)
    lasting.at_rest()
    before = lasting.fresh_truth()
    lasting.arm()
    assert lasting.control.state == SafetyState.ARMED
    lasting.heard(0.2)
    assert lasting.fresh_truth().distance_m - before.distance_m < 1e-3
    lasting.drive(0.3, 0.0, 1.0)
    assert lasting.fresh_truth().distance_m - before.distance_m > 0.1
