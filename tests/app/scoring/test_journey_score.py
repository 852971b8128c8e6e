"""Distances of an outline against dense points, and what counts as a near miss."""

import math

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import given
from hypothesis import strategies as st

from robotctl.app.scoring.journey_score import JourneyScore
from robotctl.app.scoring.outline import outline_distance
from robotctl.app.scoring.score import StampedPose
from robotctl.model.geometry.points import moved
from robotctl.model.geometry.se2 import SE2
from tests.model.polygon_bodies import bodies, shape_of

BODY = np.array([(0.3, -0.2), (0.3, 0.2), (-0.2, 0.2), (-0.2, -0.2)])


@given(st.integers(0, 2**32 - 1))
def test_the_distance_is_that_of_dense_points_from_the_rectangle(seed):
    rng = np.random.default_rng(seed)
    ends = rng.uniform(-1.0, 1.0, (3, 2, 2))
    points = ends[:, 0] + np.linspace(0, 1, 2001)[:, None, None] * (ends[:, 1] - ends[:, 0])
    low, high = np.array([-0.2, -0.2]), np.array([0.3, 0.2])
    outside = np.maximum(np.maximum(low - points, points - high), 0.0)
    expected = np.hypot(outside[..., 0], outside[..., 1]).min()
    pose = SE2(3.0, -1.0, rng.uniform(-math.pi, math.pi))
    sides = moved(pose, ends.reshape(-1, 2)).reshape(-1, 4)
    found = outline_distance(BODY, sides, pose.x_m, pose.y_m, pose.theta_rad, 9.0)
    # The points are up to 1.4 mm apart, so a corner that is only just touched may lie between two.
    assert found <= expected + 1e-12
    assert found >= expected - 1.5e-3


@given(bodies(), st.integers(0, 2**32 - 1))
def test_the_distance_of_any_body_is_what_shapely_says(body, seed):
    rng = np.random.default_rng(seed)
    sides = rng.uniform(-1.0, 1.0, (3, 4))
    score = JourneyScore([[np.array(piece) for piece in body.pieces]], sides)
    score.truth(at(0, 0.3, -0.2, 0.7))
    lines = shapely.MultiLineString([(each[:2], each[2:]) for each in sides.tolist()])
    shape = shapely.affinity.rotate(shape_of(body), 0.7, origin=(0, 0), use_radians=True)
    expected = shapely.affinity.translate(shape, 0.3, -0.2).distance(lines)
    assert score.min_clearance_m == pytest.approx(expected, abs=1e-9)


def at(seconds, x_m, y_m=0.0, theta_rad=0.0):
    return StampedPose(round(seconds * 1e9), x_m, y_m, theta_rad)


def test_a_robot_that_passes_a_wall_twice_has_two_near_misses_and_its_time():
    score = JourneyScore([[BODY]], np.array([[2.0, -5.0, 2.0, 5.0]]))
    assert score.time_s is None
    for k, x_m in enumerate((0.0, 0.05, 1.0, 1.66, 1.65, 1.64, 1.5, 1.66, 1.0)):
        score.truth(at(k, x_m))
    assert score.near_misses == 2
    assert score.min_clearance_m == pytest.approx(0.04)
    assert score.time_s == pytest.approx(6.0)


def test_a_turned_robot_that_touches_has_no_clearance():
    score = JourneyScore([[BODY]], np.array([[1.0, -5.0, 1.0, 5.0]]))
    score.truth(at(0, 0.85, 0.0, math.pi / 2))
    assert score.min_clearance_m == 0.0
    assert score.near_misses == 0


def test_somebody_who_comes_near_is_no_near_miss_of_a_robot_that_stands_or_turns_away():
    score = JourneyScore([[BODY]], np.empty((0, 4)))
    for k, gap_m in enumerate((0.5, 0.2, 0.04, 0.03)):
        score.truth(at(k, 0.0), [(0.3 + 0.22 + gap_m, 0.0)])
    score.truth(at(4, -0.02), [(0.56, 0.0)])
    assert score.near_misses == 0
    score.truth(at(5, 0.01), [(0.56, 0.0)])
    assert score.near_misses == 1
