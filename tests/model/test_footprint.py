"""A robot's outline: its circles, its points, and what is no outline."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.model.footprint import Footprint
from robotctl.model.footprint_arrays import discs, samples
from robotctl.model.polygons import sides_of

RECTANGLE = Footprint(((0.4, -0.2), (0.4, 0.2), (-0.1, 0.2), (-0.1, -0.2)))


def test_the_circles_of_a_rectangle():
    assert RECTANGLE.inscribed_m == pytest.approx(0.1)
    assert RECTANGLE.reach_m == pytest.approx(math.hypot(0.4, 0.2))


def test_a_robot_without_corners_is_a_point():
    assert (Footprint().inscribed_m, Footprint().reach_m) == (0.0, 0.0)
    assert samples(Footprint(), 0.1).tolist() == [[0.0, 0.0]]


@pytest.mark.parametrize(
    ("corners", "said"),
    [
        (((1, 0), (0, 1)), "three corners"),
        (((1, 1), (1, -1), (-1, -1), (-1, 1)), "must run counter-clockwise"),
        (((2, 1), (3, 1), (3, 2), (2, 2)), "base must lie inside"),
        (((1, -1), (0.0, 0), (1, 1), (-1, 1), (-1, -1)), "base must lie inside"),
        (((1, -1), (-0.2, 0), (1, 1), (-1, 1), (-1, -1)), "base must lie inside"),
        (
            ((1, 0), (-0.81, 0.59), (0.31, -0.95), (0.31, 0.95), (-0.81, -0.59)),  # a star
            "the one from 1, 0 to -0.81, 0.59 meets that from 0.31, -0.95 to 0.31, 0.95",
        ),
        (((1, -1), (1, 1), (-1, -1), (-1, 1)), "may only meet at its corners"),
        (((1, -1), (1, 1), (-1, 1), (-1, -1), (0, -1), (0, 1), (0, -1)), "0, -1 twice"),
        (((1, -1), (1, 1), (-1, 1), (-1, 0.5), (1, 0.5), (-1, -1)), "may only meet"),
    ],
)
def test_what_is_no_outline_is_refused(corners, said):
    with pytest.raises(ValueError, match=said):
        Footprint(corners)


@given(st.integers(3, 9), st.floats(0.05, 2.0), st.floats(0.02, 0.3), st.floats(0.0, 6.0))
def test_points_lie_in_the_outline_and_leave_no_hole(count, radius_m, spacing_m, turn):
    angles = turn + np.arange(count) * math.tau / count
    footprint = Footprint(tuple((radius_m * math.cos(a), radius_m * math.sin(a)) for a in angles))
    points = samples(footprint, spacing_m)
    for (ax, ay), (bx, by) in sides_of(footprint.corners):
        side = (bx - ax) * (points[:, 1] - ay) - (by - ay) * (points[:, 0] - ax)
        assert (side > -1e-6).all()
    rng = np.random.default_rng(0)
    weights = rng.dirichlet(np.ones(count), 50)
    inside = weights @ np.array(footprint.corners)
    covering = discs(footprint)
    apart = np.hypot(*(inside[:, np.newaxis] - covering[:, :2]).transpose(2, 0, 1))
    assert (apart <= covering[:, 2] + 1e-9).any(axis=1).all(), "the circles cover it"
    away = np.hypot(*(inside[:, np.newaxis] - points).transpose(2, 0, 1)).min(axis=1)
    assert away.max() <= spacing_m
