"""How far bodies of any polygons go until they touch a point, against shapely."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st

from robotctl.model.footprint import Footprint
from robotctl.model.footprint_arrays import side_rows
from robotctl.planning.guard.course import Course
from robotctl.planning.guard.swept_body import depth_below, free_way, way_to_contact
from tests.model.polygon_bodies import bodies, shape_of
from tests.planning.guard.test_swept_body import pose_at

ARM = Footprint(
    ((0.25, -0.5), (0.25, 0.17), (-0.2, 0.17), (-0.2, -0.17), (0.1, -0.17), (0.1, -0.5))
)
"""A robot with an arm to the right of its front."""
JAWS = Footprint(
    ((0.3, -0.3), (0.3, -0.2), (0.1, -0.2), (0.1, 0.2), (0.3, 0.2), (0.3, 0.3), (-0.3, 0.3),
     (-0.3, -0.3)),
)  # fmt: skip
AHEAD, BACK = Course(1.0, 0.0, 0.0), Course(-1.0, 0.0, 0.0)

places = st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))


@st.composite
def courses(draw):
    """Draw a way of `base`: straight, on an arc, or on the spot."""
    turn = draw(st.sampled_from([0.0]) | st.floats(-3.0, 3.0))
    if draw(st.booleans()):
        return Course(0.0, 0.0, math.copysign(1.0, turn))
    bearing = draw(st.floats(-math.pi, math.pi))
    return Course(math.cos(bearing), math.sin(bearing), turn)


def place_seen(course, way, point):
    return shapely.Point(pose_at(course, way).inverse().apply(*point))


@given(bodies(), places, courses())
def test_any_body_meets_a_point_where_it_first_covers_it(body, point, course):
    shape = shape_of(body)
    assume(shape.distance(shapely.Point(point)) > 0.002)
    way = way_to_contact(side_rows(body), *point, course)
    if way < math.inf:
        assert shape.distance(place_seen(course, way, point)) == pytest.approx(0.0, abs=1e-6)
    most = min(way, 3.0)
    ways = [at for at in np.linspace(0.0, most - 1e-3, 60) if at >= 0.0]
    assert all(shape.distance(place_seen(course, at, point)) > 0.0 for at in ways)


@given(bodies(), places)
def test_the_depth_of_a_point_in_the_body_is_its_distance_from_the_boundary(body, place):
    shape, point = shape_of(body), shapely.Point(place)
    assume(shape.boundary.distance(point) > 1e-5)
    depth_m = depth_below(side_rows(body), *place)
    assert (depth_m > 0.0) == shape.contains(point)
    if depth_m > 0.0:
        assert depth_m == pytest.approx(shape.boundary.distance(point), abs=2e-6)


@given(bodies(), places, courses())
def test_a_point_in_the_body_is_touched_at_once_if_it_gets_deeper(body, place, course):
    shape, point = shape_of(body), shapely.Point(place)
    depth_m = shape.boundary.distance(point)
    assume(shape.contains(point) and depth_m > 1e-3)
    way = way_to_contact(side_rows(body), *place, course)

    def change(way):
        return (shape.boundary.distance(place_seen(course, way, place)) - depth_m) / way

    rates = change(1e-6), change(1e-5), change(-1e-6)
    assume(max(rates) - min(rates) < 1e-3)  # else it is as near to two sides
    assume(abs(rates[0] - 0.02) > 3e-3)
    assert (way == 0.0) == (rates[0] > 0.02)


def test_a_point_beside_an_arm_is_met_by_the_arm_and_not_by_the_hull():
    rows = side_rows(ARM)
    assert way_to_contact(rows, -0.1, -0.3, AHEAD) == math.inf  # behind the arm
    assert way_to_contact(rows, -0.1, -0.3, BACK) == pytest.approx(0.2)
    assert way_to_contact(rows, -0.1, -0.3, Course(0.0, -1.0, 0.0)) == pytest.approx(0.13)
    assert way_to_contact(rows, 0.5, -0.3, AHEAD) == pytest.approx(0.25)


def test_a_point_that_leaves_one_jaw_is_met_by_the_other():
    rows = side_rows(JAWS)
    assert way_to_contact(rows, 0.2, 0.21, Course(0.0, 1.0, 0.0)) == pytest.approx(0.41)
    assert way_to_contact(rows, 0.2, 0.21, Course(0.0, -1.0, 0.0)) == 0.0
    assert way_to_contact(rows, 0.2, 0.21, BACK) == math.inf
    spun = way_to_contact(rows, 0.2, 0.21, Course(0.0, 0.0, 1.0))
    bearing = math.atan2(0.21, 0.2)
    reach = math.hypot(0.2, 0.21)
    assert spun == pytest.approx(bearing + math.asin(0.2 / reach), abs=1e-6)


def wall(y, x0=-1.0, x1=1.0):
    return np.array([(x, y) for x in np.arange(x0, x1, 0.02)])


def test_a_wall_at_the_outermost_side_is_driven_along_and_one_behind_an_arm_hides_nothing():
    rows = side_rows(ARM)
    assert free_way(rows, wall(0.165), 0.1, AHEAD) == (math.inf, None)
    beside = wall(-0.165, -0.18, 0.05)  # at the body, behind the arm
    ahead = np.array([[0.8, -0.4]])
    free, point = free_way(rows, np.vstack([beside, ahead]), 0.1, AHEAD)
    assert (free, point) == (pytest.approx(0.45), (0.8, -0.4))
