"""A robot that has stopped can be kept in a checkpoint: fault, text and part come back."""

from __future__ import annotations

import pytest

from robotctl.core.checkpoint import checkpoint, fields_of, restored
from robotctl.messages.control import SafetyState
from robotctl.messages.faults import Fault, FaultCode
from tests.core.robot_double import RobotDouble


@pytest.mark.parametrize("code", FaultCode)
def test_the_fault_of_a_stop_and_that_of_a_monitor_come_back(code: FaultCode) -> None:
    robot = RobotDouble().armed()
    fields = fields_of(robot.core)
    fault = Fault(code, "something", "drive")
    robot.core._supervision._contradiction = fault
    robot.tick()
    assert robot.state == SafetyState.FAULT
    core = restored(checkpoint(robot.core))
    assert core.machine.fault == core._supervision._contradiction == fault
    assert core.machine.fault.code is code
    assert core.machine.reason == "something"
    assert fields.items() < fields_of(core).items()  # and those of the fault
