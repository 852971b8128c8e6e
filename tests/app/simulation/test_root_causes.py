"""Faults of supply, bus and nodes that all silence the drive: each is told by its own name."""

import pytest

from robotctl.messages.control import SafetyState
from robotctl.messages.faults import FaultCode
from robotctl.safety.causes import AFTER_NS
from tests.app.simulation.test_lost_frames import MS, Robot

PASSIVE = "host_error_passive"


@pytest.mark.parametrize(
    ("faults", "code"),
    [
        (("brown_out volts=4 duration=0.5",), FaultCode.DRIVE_UNDER_VOLTAGE),
        (("brown_out volts=4 sag=0.05 duration=0.5",), FaultCode.DRIVE_UNDER_VOLTAGE),
        ((PASSIVE, "brown_out volts=4 duration=0.5"), FaultCode.DRIVE_UNDER_VOLTAGE),
        ((PASSIVE, "brown_out volts=0 sag=0.1 duration=1"), FaultCode.DRIVE_UNDER_VOLTAGE),
        (("babble node=drive duration=0.5",), FaultCode.BUS_STRANGER),
        (("babble node=power duration=0.5",), FaultCode.BUS_STRANGER),
        (("overload priority=high load=1 duration=0.5",), FaultCode.BUS_BLOCKED),
        (("host_cut duration=0.5",), FaultCode.BUS_PASSIVE),
        (("bus_short duration=0.5",), FaultCode.BUS_PASSIVE),
        (("host_bus_off duration=0.5",), FaultCode.BUS_ERRORS),
        (("node_bus_off node=drive duration=0.5",), FaultCode.BUS_ERRORS),
        (("node_silent node=drive duration=0.5",), FaultCode.WHEELS_STALE),
        (("node_reset node=drive",), FaultCode.NODE_RESTARTED),
    ],
)
def test_the_reason_names_the_cause(faults, code):
    robot = Robot()
    robot.drive(1.0, 0.4, 0.4)
    for each in faults:
        robot.inject(each)
    robot.drive(1.0, 0.4, 0.4)
    robot.idle(AFTER_NS / 1e9 + 0.01)
    state = robot.stack.snapshot()
    assert state.state is SafetyState.FAULT
    assert state.fault is code, state.reason


def test_a_drive_that_falls_silent_long_after_the_bus_became_passive_is_told_as_silent():
    robot = Robot()
    robot.drive(1.0, 0.4, 0.4)
    robot.inject(PASSIVE)
    robot.drive(1.5, 0.4, 0.4)
    robot.inject("node_silent node=drive duration=0.5")
    robot.drive(1.0, 0.4, 0.4)
    robot.idle(AFTER_NS / 1e9)
    assert robot.stack.snapshot().fault is FaultCode.WHEELS_STALE


def test_a_cause_that_shows_up_behind_the_stop_is_told_once():
    robot = Robot()
    robot.drive(1.0, 0.4, 0.4)
    robot.notices.clear()
    robot.inject("overload priority=high load=1 duration=0.5")
    began_ns = robot.now_ns
    robot.drive(1.0, 0.4, 0.4)
    assert robot.now_ns - began_ns <= 20 * MS  # the stop does not wait for it
    robot.idle(1.0)
    causes = [each for each in robot.notices if each.startswith("cause of the stop")]
    assert causes == [f"cause of the stop: {robot.stack.snapshot().reason}"]
