"""Parameters that change while the robot drives: the loop takes them, and nothing jumps."""

import itertools

import pytest

from robotctl.messages.control import ManualControl, Mode
from robotctl.messages.tuning import SetParameter
from tests.mavlink.conftest import FakeLinks
from tests.mavlink.driven_robot import DrivenRobot

MANUAL = 0
"""MANUAL of ArduRover's custom modes."""
TICK_S = 0.005


@pytest.fixture(scope="module")
def robot():
    robot = DrivenRobot(FakeLinks(), start=(3.0, 5.0, 0.0))
    robot.arm(MANUAL)
    assert robot.state.mode is Mode.MANUAL
    return robot


def drive(robot, seconds, forward=0.25):
    """Return the states of control while sticks are held."""
    states = []
    for number in range(round(seconds / TICK_S)):
        if number % 10 == 0:
            life_ns = robot.now_ns + 300_000_000
            robot.tell_navigation(ManualControl(robot.now_ns, life_ns, forward, 0.0))
        states.append(robot.tick())
    return states


def tune(robot, **values):
    for name, value in values.items():
        robot.tell_telemetry(SetParameter(robot.now_ns, 1, name, value))


def largest_step(states, value):
    """Return the largest change of a value from one period to the next."""
    values = [value(each) for each in states]
    return max(abs(b - a) for a, b in itertools.pairwise(values))


def duty(state):
    return state.duty[0]


@pytest.mark.parametrize(
    "gains",
    [
        {"CTL_L_KP": 1.3, "CTL_L_KI": 8.6},
        {"CTL_L_KP": 0.1},
        {"CTL_L_KV": 0.2, "CTL_L_KS": 0.0},
        {"CTL_L_KI": 0.0},
    ],
)
def test_another_gain_makes_no_jump_of_the_duty(robot, gains):
    quiet = drive(robot, 1.5)[-100:]
    usual = largest_step(quiet, duty)
    before = robot.tick().tuning
    tune(robot, **gains)
    states = quiet + drive(robot, 0.5)
    assert states[-1].tuning != before
    at = next(i for i, each in enumerate(states) if each.tuning != before)
    # A feed-forward of 0.25 V per rad/s less, at 4 rad/s and 12 V, would be a jump by 0.08.
    assert largest_step(states[at - 2 : at + 3], duty) <= 2.0 * usual + 0.004
    tune(robot, **dict.fromkeys(gains))
    drive(robot, 1.0)


def test_a_lower_limit_brakes_as_the_limits_allow(robot):
    config = robot.config.limits
    drive(robot, 1.5, 0.5)
    tune(robot, LIM_V_MAX=0.2)
    states = drive(robot, 1.5, 0.5)
    assert states[0].v_ref_m_s == pytest.approx(0.5 * config.v_max_m_s, abs=0.01)
    assert states[-1].v_ref_m_s == pytest.approx(0.1, abs=0.01)
    step = largest_step(states, lambda each: each.v_ref_m_s)
    assert 0.0 < step <= config.a_max_m_s2 * TICK_S * 1.001
    tune(robot, LIM_V_MAX=None)
    assert drive(robot, 0.8, 0.5)[-1].v_ref_m_s == pytest.approx(0.4, abs=0.01)
