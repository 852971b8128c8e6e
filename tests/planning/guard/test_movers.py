"""Who comes nearer, and is seen by a lidar, finds the robot at rest; by a robot in small steps."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely.geometry import Point, Polygon

from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.config import GuardConfig
from robotctl.planning.guard.movers import edge_of
from robotctl.planning.guard.obstacle_guard import ObstacleGuard

BODY = Footprint(((0.2, 0.18), (-0.17, 0.18), (-0.17, -0.18), (0.2, -0.18)))
OUTLINE = Polygon(BODY.corners)
CONFIG = GuardConfig()
RADIUS_M = 0.22
STEP_S = 0.05
LATE = round(CONFIG.reaction_s / STEP_S) - 1
"""Steps that the drives are late: a step is commanded at its beginning and lasts to its end."""
BRAKES_M_S = CONFIG.deceleration_m_s2 * STEP_S
AT_REST_M_S = 0.04 + BRAKES_M_S + 1e-6
"""Speed at which a corner may pass, and what a step brakes."""
ANGLES = np.linspace(-math.pi, math.pi, 16, endpoint=False)
RING = RADIUS_M * np.column_stack([np.cos(ANGLES), np.sin(ANGLES)])


def guard():
    return ObstacleGuard(CONFIG, (), has_lidar=True, outline=BODY)


def sees(guard, pose, place, speed):
    """Show the guard somebody at a place of `world`."""
    c, s = math.cos(pose.theta_rad), math.sin(pose.theta_rad)
    away_x, away_y = place[0] - pose.x_m, place[1] - pose.y_m
    row = [
        c * away_x + s * away_y, c * away_y - s * away_x,
        c * speed[0] + s * speed[1], c * speed[1] - s * speed[0], RADIUS_M,
    ]  # fmt: skip
    # A lidar sees them stand there, too: on a bend the body may turn into who hardly walks.
    guard.observe((), (), points_base=RING + row[:2], moving_base=[row])
    return Point(*row[:2])


def meet(wanted, place, speed):
    """Move until they touch, or 8 s; return how fast the body goes towards the person then."""
    eye, pose, share = guard(), SE2(), 1.0
    late = [1.0] * LATE
    speed_max = abs(wanted[0]) or abs(wanted[1]) * eye.reach_m
    for step in range(160):
        at = place[0] + speed[0] * STEP_S * step, place[1] + speed[1] * STEP_S * step
        there = sees(eye, pose, at, speed)
        if OUTLINE.distance(there) <= RADIUS_M:
            return closing_m_s(there, share * wanted[0], share * wanted[1])
        late.append(min(eye.step(*wanted).v_max_m_s / speed_max, 1.0))
        share = max(min(late.pop(0), share + 2.0 * STEP_S), share - BRAKES_M_S / speed_max)
        pose = pose @ SE2.exp(share * wanted[0] * STEP_S, 0.0, share * wanted[1] * STEP_S)
    return None


def closing_m_s(there, v_m_s, omega_rad_s):
    """Return the speed of the body's nearest point towards somebody [m/s]."""
    x, y = OUTLINE.exterior.interpolate(OUTLINE.exterior.project(there)).coords[0]
    away = np.array([there.x - x, there.y - y])
    move = np.array([v_m_s - omega_rad_s * y, omega_rad_s * x])
    return float(away @ move / max(np.hypot(*away), 1e-9))


def walk(bearing, aims, walks_m_s):
    """Return where somebody begins, 3 m away, and a velocity roughly towards the robot."""
    begins = 3.0 * math.cos(bearing), 3.0 * math.sin(bearing)
    aim = math.atan2(-begins[1], -begins[0]) + aims
    return begins, (walks_m_s * math.cos(aim), walks_m_s * math.sin(aim))


@settings(max_examples=150, deadline=None)
@given(
    bearing=st.floats(-math.pi, math.pi),
    aims=st.floats(-0.3, 0.3),
    walks_m_s=st.floats(0.3, 1.5),
    wanted=st.sampled_from([(0.6, 0.0), (-0.4, 0.0)]),
)
def test_who_comes_finds_a_robot_that_drives_straight_on_at_rest(bearing, aims, walks_m_s, wanted):
    met = meet(wanted, *walk(bearing, aims, walks_m_s))
    assume(met is not None)
    assert met < AT_REST_M_S


@pytest.mark.parametrize("wanted", [(0.0, 1.2), (0.0, -1.2), (0.4, 0.8), (-0.4, 0.5)])
def test_who_comes_finds_one_that_turns_at_rest_but_for_a_few(wanted):
    """A corner may turn towards somebody within the time that it takes to react."""
    rng = np.random.default_rng(7)
    walks = rng.uniform((-math.pi, -0.3, 0.3), (math.pi, 0.3, 1.5), (80, 3))
    met = [each for each in (meet(wanted, *walk(*row)) for row in walks) if each is not None]
    assert len(met) > 25
    assert np.mean(np.array(met) < AT_REST_M_S) >= 0.95


@pytest.mark.parametrize("wanted", [(0.0, 1.2), (0.0, -1.2)])
def test_a_turn_on_the_spot_ends_before_somebody_is_there(wanted):
    eye = guard()
    sees(eye, SE2(), (0.5, 0.35), (-0.8, -0.6))
    assert eye.step(*wanted).v_max_m_s < 0.1
    assert eye.step(*wanted).obstacle == "somebody comes nearer"


@pytest.mark.parametrize(
    ("place", "speed"),
    [
        ((0.8, 0.0), (0.8, 0.0)),  # goes on ahead
        ((0.8, 0.0), (0.0, 0.0)),  # stands: its points count
        ((-0.8, 0.0), (0.8, 0.0)),  # comes from behind
        ((2.0, 1.2), (-1.0, 0.0)),  # passes beside
    ],
)
def test_others_do_not_slow_it(place, speed):
    eye = guard()
    sees(eye, SE2(), place, speed)
    assert eye.step(0.4).v_max_m_s >= 0.4


def test_points_of_the_outline_are_no_farther_apart_than_a_hand_is_wide():
    edge = edge_of(BODY)
    for corner in BODY.corners:
        assert np.hypot(*(edge - corner).T).min() < 1e-9
    around = np.vstack([edge, edge[:1]])
    assert np.hypot(*np.diff(around, axis=0).T).max() <= 0.1 + 1e-9
    assert all(OUTLINE.exterior.distance(Point(*each)) < 1e-9 for each in edge)
