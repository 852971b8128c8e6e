"""A robot that is to stand does not push against what has stopped it before."""

import numpy as np
import pytest

from robotctl.control.limiter import LimitsConfig, TwistLimiter
from robotctl.messages.control import SafetyState
from robotctl.messages.faults import FaultCode
from robotctl.model.geometry.twist import Twist
from tests.core.robot_double import PERIOD_NS, RobotDouble

TICKS_PER_S = 1_000_000_000 // PERIOD_NS
PERIOD_S = 1.0 / TICKS_PER_S
REST = (0.0, 0.0)


def under_way(v_m_s, omega_rad_s):
    robot = RobotDouble().armed()
    robot.ticks(2 * TICKS_PER_S, (v_m_s, omega_rad_s))
    return robot


def reference(robot):
    state = robot.snapshot()
    return Twist(state.v_ref_m_s, state.omega_ref_rad_s)


@pytest.mark.parametrize("v_m_s", [0.5, -0.5, 0.2])
def test_what_holds_it_while_it_brakes_is_pushed_for_a_moment_only(v_m_s):
    robot = under_way(v_m_s, 0.0)
    robot.held = True
    robot.tick(robot.velocity(*REST))
    assert abs(reference(robot).v_m_s) <= 0.1 + 1e-9
    pushes = []
    for _ in range(TICKS_PER_S):
        robot.tick(robot.velocity(*REST))
        pushes.append(max(map(abs, robot.currents_a())))
    assert robot.state is SafetyState.ARMED
    assert sum(np.array(pushes) > 1.0) * PERIOD_S < 0.3  # shorter than what is taken for a fault
    assert not any(pushes[round(0.6 * TICKS_PER_S) :])


def test_on_an_arc_it_stays_on_the_arc():
    robot = under_way(0.4, 0.6)
    robot.held = True
    robot.tick(robot.velocity(*REST))
    first = reference(robot)
    assert first.omega_rad_s / first.v_m_s == pytest.approx(1.5, rel=0.05)


def test_what_holds_it_while_it_is_to_drive_is_a_fault():
    robot = under_way(0.4, 0.0)
    robot.held = True
    robot.ticks(TICKS_PER_S, (0.4, 0.0))
    assert robot.snapshot().fault == FaultCode.WHEEL_BLOCKED


@pytest.mark.parametrize("twist", [(0.5, 0.0), (-0.4, 0.5), (0.3, -1.0)])
def test_a_free_robot_brakes_on_the_ramp_of_its_limits(twist):
    robot = under_way(*twist)
    limiter = TwistLimiter(LimitsConfig())
    limiter.reset(reference(robot))
    for _ in range(TICKS_PER_S):
        robot.tick(robot.velocity(*REST))
        assert reference(robot) == pytest.approx(limiter.step(Twist(*REST), PERIOD_S), abs=1e-12)
