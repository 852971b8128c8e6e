"""Arcs to goals that move, against the geometry of a circle."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.path.global_planning.arc import arc_to
from robotctl.planning.path.global_planning.goal import Goal

RADIUS_M = 0.5
bearings = st.floats(-0.95, 0.95).map(lambda rad: rad if abs(rad) > 1e-6 else 0.0)


@given(st.floats(0.05, 1.99), bearings, st.floats(-3.0, 3.0))
def test_an_arc_leaves_along_the_heading_and_its_points_are_on_one_circle(away_m, bearing, heading):
    start = SE2(1.0, -2.0, heading)
    end = start @ SE2(away_m * math.cos(bearing), away_m * math.sin(bearing), 0.0)
    plan = arc_to(start, Goal(end.x_m, end.y_m, None), RADIUS_M)
    # The circle through the goal that touches the heading has this radius (inscribed angle).
    radius_m = 0.5 * away_m / abs(math.sin(bearing)) if bearing else math.inf
    if radius_m < RADIUS_M:
        assert plan is None
        return
    assert plan is not None
    assert plan.poses[-1, :2] == pytest.approx((end.x_m, end.y_m), abs=1e-9)
    assert plan.length_m == pytest.approx(
        away_m * bearing / math.sin(bearing) if bearing else away_m, rel=1e-3
    )
    if bearing:
        side = math.copysign(radius_m, bearing)
        centre = start.apply(0.0, side)
        away = np.hypot(*(plan.poses[:, :2] - centre).T)
        assert away == pytest.approx(np.full(len(away), radius_m), rel=1e-6)
    assert wrap_angle(plan.poses[-1, 2] - heading - 2.0 * bearing) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    "goal",
    [
        Goal(3.0, 0.0, None),  # far away
        Goal(0.0, 1.0, None),  # beside
        Goal(-1.0, 0.0, None),  # behind
        Goal(1.0, 0.0, 0.5),  # with a heading
        Goal(0.0, 0.0, None),  # here
    ],
)
def test_there_is_none_where_a_planned_path_is_better(goal):
    assert arc_to(SE2(), goal, RADIUS_M) is None
