"""Lanes against discs that really walk along them."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from shapely.affinity import rotate, translate
from shapely.geometry import Point, Polygon

from robotctl.model.geometry.angles import wrap_angle
from robotctl.planning.map.lane import Lane

CORNERS = np.array([(0.45, -0.18), (0.45, 0.18), (-0.1, 0.18), (-0.1, -0.18)])


@given(
    heading=st.floats(-math.pi, math.pi),
    turned=st.floats(-math.pi, math.pi),
    x=st.floats(-3.0, 3.0),
    y=st.floats(-3.0, 3.0),
)
def test_a_gap_is_never_more_than_who_walks_there_leaves(heading, turned, x, y):
    lane = Lane.of(np.array([0.3, -0.2, 0.8 * math.cos(heading), 0.8 * math.sin(heading), 0.22]))
    body = translate(rotate(Polygon(CORNERS), turned, (0.0, 0.0), use_radians=True), x, y)
    walked = [lane.after(0.02 * step) for step in range(600)]
    true_m = min(body.distance(Point(each.x_m, each.y_m)) for each in walked) - 0.22
    (gap_m,) = lane.gaps_m(CORNERS, np.array([[x, y, turned]]), 0.0)
    if math.isinf(gap_m):
        assert true_m > -1e-9
    else:
        assert gap_m <= true_m + 1e-9
        (wider_m,) = lane.gaps_m(CORNERS, np.array([[x, y, turned]]), 0.1)
        assert wider_m <= gap_m


def test_lengths_along_and_beside_are_those_of_its_user():
    lane = Lane.of(np.array([1.0, 2.0, 0.0, 0.5, 0.22]))
    places = np.array([[1.0, 5.0], [0.0, 2.0]])
    assert lane.ahead_m(places).tolist() == [3.0, 0.0]
    assert lane.beside_m(places).tolist() == [0.0, 1.0]
    assert lane.after(2.0)[:2] == (1.0, 3.0)


@given(
    heading=st.floats(-math.pi, math.pi),
    off=st.floats(-0.34, 0.34),
    opposite=st.booleans(),
)
def test_a_lane_along_a_line_leads_on_in_the_same_direction(heading, off, opposite):
    lane = Lane.of(np.array([1.0, 2.0, 0.7 * math.cos(heading), 0.7 * math.sin(heading), 0.2]))
    straight = lane.straightened(heading + off + opposite * math.pi, 0.35)
    assert straight[:2] == lane[:2]
    assert straight[4:] == lane[4:]
    assert abs(wrap_angle(straight.heading_rad - heading - off)) < 1e-9


@given(off=st.floats(0.36, math.pi - 0.36))
def test_a_lane_across_a_line_stays_as_it_is(off):
    lane = Lane.of(np.array([1.0, 2.0, 0.7, 0.0, 0.2]))
    assert lane.straightened(off, 0.35) == lane
