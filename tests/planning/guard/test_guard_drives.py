"""Robots that are told to drive into a wall, under any angle and in any bend, do not touch it."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from robotctl.messages.mode import Mode
from robotctl.messages.requests import ModeRequest, VelocityRequest
from robotctl.model.geometry.se2 import SE2

GUIDED = ModeRequest(Mode.GUIDED)
LATER = 1_000_000_000_000
WALL = np.array([(-50.0, 2.0, 50.0, 2.0), (-50.0, -3.0, 50.0, -3.0)])
ROOM = np.array([(0, 0, 3, 0), (3, 0, 3, 2.2), (3, 2.2, 0, 2.2), (0, 2.2, 0, 0)])


def drive(make_run, robot, pose, v, omega, seconds):
    """Return a run of a robot near a long wall at y = 2, whose sonars hear no flat incidence."""
    run = make_run(robot, start=pose, flat=False, most_incidence_deg=35.0, range_noise_m=0.005)
    run.world.walls = WALL
    run.world.check_contact()
    assert run.world.touched == 0
    run.step(GUIDED, VelocityRequest(LATER, v, omega))
    while run.now_ns < seconds * 1e9 and run.world.touched == 0:
        run.step()
    return run


@pytest.mark.parametrize("angle_deg", [15.0, 30.0, 42.0, 48.0, 60.0, 90.0])
@pytest.mark.parametrize("v", [0.25, 0.4, 0.8, -0.25, -0.4, -0.8])
def test_a_wall_met_at_an_angle_is_not_touched(make_run, robot, angle_deg, v):
    angle = math.radians(angle_deg)
    away = 1.0 + 0.5 * math.sin(angle)
    pose = SE2(0.0, 2.0 - away, math.copysign(angle, v))
    run = drive(make_run, robot, pose, v, 0.0, away / math.sin(angle) / abs(v) + 2.0)
    assert run.world.touched == 0
    assert run.world.twist.v_m_s == pytest.approx(0.0, abs=0.01)
    assert run.world.distance_m > 0.3  # it went near


@pytest.mark.parametrize("distance_m", [0.35, 0.5, 0.7])
@pytest.mark.parametrize(("v", "radius_m"), [(0.4, 0.55), (0.4, 1.0), (0.8, 1.0)])
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_bend_towards_a_wall_beside_ends_before_it(
    make_run, robot, distance_m, v, radius_m, direction
):
    pose = SE2(0.0, 2.0 - distance_m, 0.0)
    run = drive(make_run, robot, pose, direction * v, direction * v / radius_m, 5.0)
    assert run.world.touched == 0


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    theta=st.floats(-math.pi, math.pi),
    away_m=st.floats(0.6, 1.8),
    speed=st.floats(0.1, 0.8),
    direction=st.sampled_from([1.0, -1.0]),
    curvature=st.floats(-2.0, 2.0),
)
@example(theta=0.73, away_m=1.2, speed=0.8, direction=1.0, curvature=0.0)
def test_no_motion_asked_for_touches_a_wall(
    make_run, robot, theta, away_m, speed, direction, curvature
):
    v = direction * speed
    run = drive(make_run, robot, SE2(0.0, 2.0 - away_m, theta), v, curvature * speed, 6.0)
    assert run.world.touched == 0


@pytest.mark.parametrize("distance_m", [0.35, 0.5])
def test_beside_a_wall_the_way_straight_on_is_free(make_run, robot, distance_m):
    run = drive(make_run, robot, SE2(0.0, 2.0 - distance_m, 0.0), 0.3, 0.0, 5.0)
    assert run.world.touched == 0
    assert run.world.distance_m == pytest.approx(1.5, abs=0.1)


@pytest.mark.parametrize("seed", range(8))
def test_whoever_steers_at_random_through_a_small_room_touches_nothing(make_run, robot, seed):
    rng = random.Random(seed)
    start = SE2(1.5, 1.1, rng.uniform(-3.0, 3.0))
    run = make_run(robot, start=start, flat=False, seed=seed, most_incidence_deg=35.0)
    run.world.range_noise_m, run.world.outliers = 0.005, 0.005
    run.world.walls = ROOM
    run.step(GUIDED)
    while run.now_ns < 25e9:
        v = rng.choice([-1, 1]) * rng.uniform(0.1, 0.8)
        wish = VelocityRequest(LATER, v, v * rng.choice([0.0, rng.uniform(-2.0, 2.0)]))
        for _ in range(rng.randint(3, 40)):
            run.step(wish)
    assert run.world.touched == 0
