"""The emergency stop from each source, at any moment: it wins, latches, and ends by arming."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable

import can
import pytest

from hil_tests.ground_station import GroundStation, mavlink
from hil_tests.rig import EMERGENCY_STOP, Rig
from robotctl.app.stack import CONTROL
from robotctl.runtime.messages import SafetyState

OPERATOR_FRAME = can.Message(arbitration_id=EMERGENCY_STOP, data=b"\x01", is_extended_id=False)
SOURCES: dict[str, Callable[[Rig], None]] = {
    "frame on the bus": lambda rig: rig.observer.send(OPERATOR_FRAME),
    "request of a process": Rig.emergency_stop,
    "SIGUSR1": lambda rig: rig.send_signal(CONTROL, signal.SIGUSR1),
}

source = pytest.mark.parametrize("source", list(SOURCES))


def assert_latched(rig: Rig) -> None:
    """Assert that commands move nothing until the robot has been armed, and then do."""
    rig.at_rest()
    before = rig.fresh_truth()
    rig.drive(0.5, 0.0, 0.5)
    assert rig.control.state == SafetyState.EMERGENCY_STOP
    assert rig.fresh_truth().distance_m - before.distance_m < 1e-3
    rig.arm()
    rig.drive(0.3, 0.0, 1.0)
    assert rig.fresh_truth().distance_m - before.distance_m > 0.1


@source
def test_while_driving(armed: Rig, source: str, reaction: Callable[[str, float], None]) -> None:
    armed.drive(0.5, 0.0, 1.0)
    armed.heard(0.05)
    asked_s = time.time()
    SOURCES[source](armed)
    if source != "frame on the bus":
        heard_s = armed.heard_until(EMERGENCY_STOP, 1.0)[-1].timestamp
        reaction(f"emergency stop by {source}: on the bus", 1000 * (heard_s - asked_s))
    state = armed.wait_for_state(SafetyState.EMERGENCY_STOP, 1.0)
    assert "emergency stop" in state.reason
    assert_latched(armed)


@source
def test_twice(armed: Rig, source: str) -> None:
    armed.drive(0.5, 0.0, 0.5)
    for _ in range(2):
        SOURCES[source](armed)
        armed.wait_for_state(SafetyState.EMERGENCY_STOP, 1.0)
    assert_latched(armed)


@source
def test_while_the_robot_starts(rig: Rig, source: str) -> None:
    rig.start()
    rig.wait(lambda: rig.control is not None, 5.0, "the control process is there")
    SOURCES[source](rig)
    rig.wait_for_state(SafetyState.EMERGENCY_STOP, 1.0)
    rig.wait(lambda: not any(node.problem for node in rig.control.nodes), 10, "nodes are ready")
    assert_latched(rig)


@source
def test_right_behind_a_request_to_arm(armed: Rig, source: str) -> None:
    SOURCES[source](armed)
    armed.wait_for_state(SafetyState.EMERGENCY_STOP, 1.0)
    armed.ask_to_arm()
    SOURCES[source](armed)
    armed.wait_for_state(SafetyState.EMERGENCY_STOP, 1.0)
    armed.heard(1.5)  # longer than a request to arm may wait
    armed.listen()
    assert armed.control.state == SafetyState.EMERGENCY_STOP
    assert_latched(armed)


def test_by_the_ground_station_it_latches_and_arming_from_there_ends_it(
    station: GroundStation, reaction: Callable[[str, float], None]
) -> None:
    rig = station.rig
    assert station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == mavlink.MAV_RESULT_ACCEPTED
    rig.wait_for_state(SafetyState.ARMED)
    rig.drive(0.4, 0.0, 0.5)
    rig.heard(0.05)
    asked_s = time.time()
    station.command(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1)
    heard_s = rig.heard_until(EMERGENCY_STOP, 1.0)[-1].timestamp
    reaction("emergency stop by MAVLink: on the bus", 1000 * (heard_s - asked_s))
    rig.wait_for_state(SafetyState.EMERGENCY_STOP, 1.0)
    rig.at_rest()

    def armed() -> bool:  # a request within a second of the last one may be a late copy of it
        result = station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        rig.heard(0.2)
        return result == mavlink.MAV_RESULT_ACCEPTED

    rig.wait(armed, 5.0, "arming is accepted")
    rig.wait_for_state(SafetyState.ARMED)
