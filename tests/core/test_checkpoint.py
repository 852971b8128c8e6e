"""A robot that has stopped can be kept in a checkpoint: fault, text and part come back."""

from __future__ import annotations

import pytest

from robotctl.app.processes.robot import make_core
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.core.checkpoint import checkpoint, fields_of, restored
from robotctl.core.warmup import rehearse
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


def test_a_robot_with_an_imu_is_rehearsed_kept_and_comes_back() -> None:
    config = load_robot(find_file("diff_drive"), ["imu.enabled=true"])
    core = make_core(config, StackOptions("x", ""))
    assert rehearse(core, config.runtime.period_ns)
    again = restored(checkpoint(core))
    assert again.motion.imu == core.motion.imu is not None
    assert fields_of(again) == fields_of(core)
