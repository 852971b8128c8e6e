"""How far a body goes until it touches a point, against a body that is moved in small steps."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import assume, example, given
from hypothesis import strategies as st

from robotctl.model.footprint import Footprint
from robotctl.model.footprint_arrays import side_rows
from robotctl.model.geometry.se2 import SE2
from robotctl.model.polygons import sides_of
from robotctl.planning.guard.course import Course
from robotctl.planning.guard.swept_body import free_way, way_to_contact

RECTANGLE = Footprint.rectangle(-0.15, 0.25, 0.18)
BODY = side_rows(RECTANGLE)
STEP = 0.001


def depths(point, pose, outline=RECTANGLE):
    """Return how deep below each side of the body at a pose a point lies, the least first [m]."""
    x, y = pose.inverse().apply(*point)
    return sorted(
        ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / math.dist((ax, ay), (bx, by))
        for (ax, ay), (bx, by) in sides_of(outline.corners)
    )


def depth(point, pose, outline=RECTANGLE):
    """Return how deep in the body at a pose a point lies [m]; below 0: outside of it."""
    return depths(point, pose, outline)[0]


def ways_to_contact(points, course):
    return np.array([way_to_contact(BODY, x, y, course) for x, y in points])


def pose_at(course, way):
    """Return the pose after a way on an arc, or on the spot."""
    ahead, left, turn = course
    if ahead == left == 0.0:
        return SE2(0.0, 0.0, turn * way)
    if abs(turn) < 1e-9:
        return SE2(ahead * way, left * way, 0.0)
    s, c = math.sin(turn * way) / turn, (1.0 - math.cos(turn * way)) / turn
    return SE2(ahead * s - left * c, left * s + ahead * c, turn * way)


def walk(point, course, most, outline=RECTANGLE):
    """Return the first way at which the body holds a point, in small steps; inf: never."""
    for k in range(1, round(most / STEP)):
        if depth(point, pose_at(course, STEP * k), outline) >= 0.0:
            return STEP * k
    return math.inf


@given(
    st.floats(-0.8, 0.8),
    st.floats(-0.8, 0.8),
    st.sampled_from([math.pi, None, 0.0]) | st.floats(-math.pi, math.pi),
    st.floats(-4.0, 4.0),
)
@example(0.0, 0.0, 2.2e-311, 0.0)
def test_a_point_is_met_where_the_body_comes_to_it(x, y, bearing, turn):
    course = Course(0.0, 0.0, math.copysign(1.0, turn))
    if bearing is not None:
        left = 0.0 if bearing in (0.0, math.pi) else math.sin(bearing)
        course = Course(math.cos(bearing), left, turn)
    turn = course.turn
    outside = depth((x, y), SE2())
    first, second, _, _ = depths((x, y), SE2())
    if abs(outside) < 0.005 or second - first < 1e-4:
        return  # on a side, or as near to two
    way = way_to_contact(BODY, x, y, course)
    if outside > 0.0:  # at once, or never as it leaves
        change = (depth((x, y), pose_at(course, 1e-5)) - outside) / 1e-5
        if abs(change - 0.02) > 1e-3:
            assert way == (0.0 if change > 0.02 else math.inf)
        return
    met = walk((x, y), course, min(way, 2.0) + 0.05)
    if met < math.inf:
        assert way == pytest.approx(met, abs=0.03 * (1.0 + abs(turn)))
        assert way <= met
    elif way < 2.0:  # a corner goes by, deeper than a step shows
        deepest = max(depth((x, y), pose_at(course, s)) for s in np.linspace(way, way + 0.02, 200))
        assert deepest > -1e-6


@st.composite
def outlines(draw):
    """Draw a convex outline around `base`, the hull of some points."""
    found = draw(st.lists(st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)), min_size=3))
    hull = shapely.MultiPoint([(round(x, 2), round(y, 2)) for x, y in found]).convex_hull
    assume(hull.geom_type == "Polygon" and hull.contains(shapely.Point(0.0, 0.0).buffer(0.01)))
    return Footprint(tuple(shapely.orient_polygons(hull).exterior.coords[:-1]))


@given(
    outlines(),
    st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)),
    st.floats(-math.pi, math.pi),
    st.floats(-3.0, 3.0),
    st.booleans(),
)
@example(
    Footprint(((0.2, -0.5), (0.3, 0.1), (-0.2, 0.1), (-0.2, -0.1))), (0.6, -0.3), 0.0, -1.0, False
)
def test_any_outline_meets_a_point_where_it_first_covers_it(outline, point, bearing, turn, spins):
    course = Course(math.cos(bearing), math.sin(bearing), turn)
    if spins:
        course = Course(0.0, 0.0, math.copysign(1.0, turn))
    shape = shapely.Polygon(outline.corners)
    assume(shape.distance(shapely.Point(point)) > 0.002)
    way = way_to_contact(side_rows(outline), *point, course)

    def gap(at):
        x, y = pose_at(course, at).inverse().apply(*point)
        return shape.distance(shapely.Point(x, y))

    if way < math.inf:
        assert gap(way) == pytest.approx(0.0, abs=1e-6)
    most = min(way, 3.0)
    assert all(gap(at) > 0.0 for at in np.linspace(0.0, most - 1e-3, 60) if at >= 0.0)


def test_an_arc_that_is_nearly_straight_is_as_good_as_a_straight_line():
    points = np.random.default_rng(1).uniform(-2.0, 2.0, (200, 2))
    straight = np.minimum(ways_to_contact(points, Course(1.0, 0.0, 0.0)), 10.0)
    for turn in (1e-12, 0.99e-4, 1.01e-4, -1.01e-4):
        ways = ways_to_contact(points, Course(1.0, 0.0, turn))  # or once round a great circle
        assert np.minimum(ways, 10.0) == pytest.approx(straight, abs=2e-3)


@pytest.mark.parametrize("course", [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.8), (0.6, 0.8, -2.0), (0, 0, 1)])
def test_the_first_point_is_the_one_that_is_met_first_of_all_alone(course):
    points = np.random.default_rng(2).uniform(-0.8, 0.8, (100, 2))
    points = points[(np.abs(points) > (0.26, 0.19)).any(axis=1)]  # outside of the body
    course = Course(*map(float, course))
    ways = ways_to_contact(points, course)
    nearest = tuple(points[ways.argmin()].tolist())
    assert free_way(BODY, points, 0.0, course) == (ways.min(), nearest)


def test_the_margin_is_a_way_of_the_part_that_would_touch():
    turning = np.array([[0.0, 0.28]])  # the front left corner comes there
    angle = way_to_contact(BODY, 0.0, 0.28, Course(0.0, 0.0, 1.0))
    assert free_way(BODY, turning, 0.1, Course(0.0, 0.0, 1.0)) == (
        pytest.approx(angle - 0.1 / 0.28),
        (0.0, 0.28),
    )
    ahead = np.array([[1.0, 0.1], [0.9, 0.1], [0.3, 0.5]])
    assert free_way(BODY, ahead, 0.1, Course(1.0, 0.0, 0.0)) == (pytest.approx(0.55), (0.9, 0.1))
    assert free_way(BODY, ahead[2:], 0.1, Course(1.0, 0.0, 0.0)) == (math.inf, None)
    assert free_way(BODY, np.empty((0, 2)), 0.1, Course(1.0, 0.0, 0.5)) == (math.inf, None)


def wall(y, x0=-1.0, x1=1.0):
    return np.column_stack([np.arange(x0, x1, 0.02), np.full(len(np.arange(x0, x1, 0.02)), y)])


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_wall_that_reaches_in_at_a_side_is_driven_along_up_to_what_sticks_out_of_it(side):
    along = wall(side * 0.165)
    for turn in (0.0, -side * 0.05):
        assert free_way(BODY, along, 0.1, Course(1.0, 0.0, turn)) == (math.inf, None)
        assert free_way(BODY, along, 0.1, Course(-1.0, 0.0, -turn)) == (math.inf, None)
    post = np.vstack([along, [[0.9, side * 0.1]]])
    assert free_way(BODY, post, 0.1, Course(1.0, 0.0, 0.0)) == (
        pytest.approx(0.55),
        (0.9, side * 0.1),
    )


def test_turning_into_a_wall_beside_is_not_allowed():
    free, point = free_way(BODY, wall(0.165), 0.1, Course(1.0, 0.0, 1.0))
    assert free <= 0.0
    assert point is not None


def test_only_what_is_beside_the_robot_makes_a_wall_of_what_is_ahead():
    ahead = wall(0.165, 0.4, 1.0)
    assert free_way(BODY, ahead, 0.1, Course(1.0, 0.0, 0.0))[0] == pytest.approx(0.05, abs=0.01)
    two = np.vstack([ahead, [[0.0, 0.165], [0.05, 0.165]]])
    assert free_way(BODY, two, 0.1, Course(1.0, 0.0, 0.0))[0] == pytest.approx(0.05, abs=0.01)


def test_points_deep_in_the_body_hide_nothing_ahead():
    deep = np.vstack([wall(0.11, -0.05, 0.1), [[0.6, 0.12]]])
    assert free_way(BODY, deep, 0.1, Course(1.0, 0.0, 0.0)) == (pytest.approx(0.25), (0.6, 0.12))


def test_driving_sideways_into_a_wall_that_reaches_in_is_not_allowed_and_away_from_it_is():
    assert free_way(BODY, wall(0.165), 0.1, Course(0.0, 1.0, 0.0))[0] <= 0.0
    assert free_way(BODY, wall(0.165), 0.1, Course(0.0, -1.0, 0.0)) == (math.inf, None)
    assert free_way(BODY, wall(0.5), 0.1, Course(0.0, 1.0, 0.0))[0] == pytest.approx(0.22)
    aslant = Course(math.sqrt(0.5), math.sqrt(0.5), 0.0)
    assert free_way(BODY, wall(0.5), 0.1, aslant)[0] == pytest.approx(0.32 * math.sqrt(2.0) - 0.1)
