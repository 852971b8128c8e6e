"""A monitor is a class and a line in `MONITORS`: what it finds stops a powered robot."""

from __future__ import annotations

import pytest

from robotctl.messages.control import SafetyState
from robotctl.messages.faults import Fault, FaultCode
from robotctl.safety import supervision
from robotctl.safety.monitor import Monitored, MonitorInputs
from tests.core.robot_double import RobotDouble

LIMIT_RAD_S = 3.0
TOO_FAST = Fault(FaultCode.ENCODER_WRONG, "a wheel turns too fast", "left")


class SpeedMonitor:
    """Finds wheels that are faster than a limit."""

    def __init__(self, robot: Monitored) -> None:
        assert [each.name for each in robot.actuators] == ["left", "right"]
        self.resets = 0

    def reset(self) -> None:
        self.resets += 1

    def update(self, inputs: MonitorInputs) -> Fault | None:
        assert inputs.command.enable or inputs.motion.speeds_rad_s[0] < 1.0
        return TOO_FAST if max(inputs.motion.speeds_rad_s) > LIMIT_RAD_S else None


@pytest.fixture
def robot(monkeypatch: pytest.MonkeyPatch) -> RobotDouble:
    monkeypatch.setattr(supervision, "MONITORS", (*supervision.MONITORS, SpeedMonitor))
    return RobotDouble()


def test_a_monitor_more_stops_the_robot_by_its_fault(robot: RobotDouble) -> None:
    robot.armed().ticks(200, (0.1, 0.0))
    assert robot.state == SafetyState.DRIVING
    robot.ticks(200, (0.5, 0.0))
    state = robot.snapshot()
    assert (state.state, state.reason) == (SafetyState.FAULT, TOO_FAST.text)
    assert (state.fault, state.fault_part) == (TOO_FAST.code, TOO_FAST.part)
    assert not robot.outputs.command.enable


def test_what_a_monitor_found_is_forgotten_by_arming_again(robot: RobotDouble) -> None:
    robot.armed().ticks(400, (0.5, 0.0))
    assert robot.state == SafetyState.FAULT
    robot.ticks(200)
    robot.arm()
    robot.ticks(100, (0.1, 0.0))
    assert robot.state == SafetyState.DRIVING
    assert robot.snapshot().fault is FaultCode.NONE
    assert robot.core._supervision._monitors[-1].resets == 2
