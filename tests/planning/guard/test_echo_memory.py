"""Echoes that are kept while no sonar hears them, and what they keep a robot from."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robotctl.messages.mode import Mode
from robotctl.messages.requests import ModeRequest, VelocityRequest
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.guard.echo_memory import EchoMemory

S = 1_000_000_000
LATER = 1000 * S
NOTHING = (math.nan, math.nan)
STAND = (False, False)
FRONT = SonarMount("front", 0.2, 0.0, 0.0)
LEFT = SonarMount("left", 0.0, 0.15, 90.0)
BODY = Footprint.rectangle(-0.2, 0.2, 0.15)


def memory() -> EchoMemory:
    """Return one that has heard something 0.5 m ahead of the front sonar at the origin."""
    kept = EchoMemory((FRONT, LEFT), BODY)
    kept.hear(SE2(), (0.5, math.nan), STAND, 0)
    kept.hear(SE2(), (0.51, math.nan), STAND, S // 20)
    return kept


def test_what_is_passed_stays_where_it_was_heard():
    kept = memory()
    beside = SE2(0.7, -0.4, 0.0)
    np.testing.assert_allclose(kept.hear(beside, NOTHING, STAND, S), [[0.01, 0.4]], atol=1e-9)
    turned = SE2(0.7, -0.4, math.pi / 2)
    np.testing.assert_allclose(kept.hear(turned, NOTHING, STAND, S), [[0.4, -0.01]], atol=1e-9)


def test_one_echo_alone_is_chance():
    kept = EchoMemory((FRONT, LEFT), BODY)
    kept.hear(SE2(), (0.5, math.nan), STAND, 0)
    assert len(kept.hear(SE2(), (0.7, math.nan), STAND, S)) == 0
    assert len(kept.hear(SE2(), (math.inf, math.nan), STAND, S)) == 0


@pytest.mark.parametrize(
    ("pose", "readings", "count"),
    [
        (SE2(0.7, -0.4, 0.0), (math.nan, 0.9), 0),  # the left sonar hears a wall behind it
        (SE2(0.7, -0.4, 0.0), (math.nan, 0.3), 1),  # or something before it
        (SE2(0.7, -0.4, 0.0), (math.nan, math.inf), 1),  # or nothing: it may look along a wall
        (SE2(0.6, 0.0, 0.0), NOTHING, 0),  # the robot stands there
        (SE2(-1.0, 0.0, 0.0), NOTHING, 0),  # it is far away
    ],
)
def test_it_goes_where_the_robot_is_or_hears_through(pose, readings, count):
    kept = memory()
    kept.hear(pose, readings, STAND, S)
    # What was taken up meanwhile counts only if the next reading agrees.
    assert len(kept.hear(pose, NOTHING, STAND, S)) == count


def test_what_moves_is_not_kept_and_shows_that_what_was_kept_before_it_is_gone():
    """Somebody stands before the robot, and then walks away ahead of it."""
    kept = memory()
    walks = (True, False)
    assert len(kept.hear(SE2(), (0.6, math.nan), walks, S)) == 1  # within what an echo is off
    assert len(kept.hear(SE2(), (0.7, math.nan), walks, S)) == 0
    for tick in range(4):
        assert len(kept.hear(SE2(), (0.7, math.nan), walks, 2 * S + tick)) == 0
    kept.hear(SE2(), (0.7, math.nan), STAND, 3 * S)
    assert len(kept.hear(SE2(), (0.7, math.nan), STAND, 4 * S)) == 1


def test_it_is_forgotten_in_time():
    assert len(memory().hear(SE2(), NOTHING, STAND, 20 * S)) == 1
    assert len(memory().hear(SE2(), NOTHING, STAND, 21 * S)) == 0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_robot_does_not_turn_into_the_end_of_a_wall_that_it_has_passed(
    make_run, differential, side
):
    """The end of a thin wall across its way lies between two sonars when the robot is beside it."""
    run = make_run(differential, flat=False, most_incidence_deg=50.0)
    run.world.walls = np.array([(0.9, side * 0.22, 0.9, side * 3.0)])
    run.step(ModeRequest(Mode.GUIDED))
    while run.world.pose.x_m < 0.86:
        run.step(VelocityRequest(LATER, 0.2, 0.0))
    for _ in range(200):
        run.step(VelocityRequest(LATER, 0.0, side * 1.0))
    assert run.world.touched == 0
    for _ in range(200):
        run.step(VelocityRequest(LATER, 0.15, side * 0.5))
    assert run.world.touched == 0


def test_a_robot_that_is_found_elsewhere_forgets_what_it_has_heard(make_run, differential):
    run = make_run(differential, flat=False, most_incidence_deg=50.0)
    run.world.walls = np.array([(0.6, -1.0, 0.6, 1.0)])
    run.step(ModeRequest(Mode.GUIDED))
    for _ in range(40):
        run.step(VelocityRequest(LATER, 0.2, 0.0))
    assert run.world.twist.v_m_s == pytest.approx(0.0, abs=0.01)
    run.world.walls, run.found = np.array([(50.0, 0.0, 50.0, 1.0)]), 1
    for _ in range(40):
        run.step(VelocityRequest(LATER, 0.2, 0.0))
    assert run.world.twist.v_m_s == pytest.approx(0.2, abs=0.01)
