"""What a scan sees, against straight lines between sensor and place."""

import math

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely.geometry import LineString, Point

from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.planning.map.sight import seen_along, sees

BEAMS = np.linspace(-math.pi, math.pi, 720, endpoint=False)
WALL = LineString([(2.0, -1.0), (2.0, 0.0)])
"""Below y = 0 it hides what is behind it from a robot at (0, -0.5)."""


def scan(pose, beams=BEAMS):
    ranges = []
    for angle in pose.theta_rad + beams:
        end = pose.x_m + 8.0 * math.cos(angle), pose.y_m + 8.0 * math.sin(angle)
        hit = LineString([(pose.x_m, pose.y_m), end]).intersection(WALL)
        away = math.inf if hit.is_empty else math.hypot(hit.x - pose.x_m, hit.y - pose.y_m)
        ranges.append(away)
    return RangeScan(0, beams, np.array(ranges), 8.0)


POSE = SE2(0.0, -0.5, 0.7)
SCAN = scan(POSE)


@settings(max_examples=300)
@given(x=st.floats(-7.0, 7.0), y=st.floats(-3.0, 3.0))
def test_a_place_is_seen_where_no_wall_is_before_it(x, y):
    line = LineString([(POSE.x_m, POSE.y_m), (x, y)])
    assume(line.length < 7.9)
    assume(Point(x, y).distance(WALL) > 0.2)
    assume(min(line.distance(Point(end)) for end in WALL.coords) > 0.15)
    assert sees(POSE, SCAN, np.array([[x, y]]))[0] == (not line.intersects(WALL))


def test_nothing_is_seen_where_no_beam_looks():
    ahead = scan(POSE, np.linspace(-1.0, 1.0, 200))
    behind = POSE @ SE2(-1.0, 0.0, 0.0)
    before = POSE @ SE2(0.5, 0.0, 0.0)
    places = np.array([(behind.x_m, behind.y_m), (before.x_m, before.y_m)])
    assert sees(POSE, ahead, places).tolist() == [False, True]


def test_a_path_round_a_corner_is_seen_up_to_it():
    pose = SE2(0.0, -0.5, 0.0)
    straight = np.column_stack([np.linspace(0.0, 1.5, 31), np.full(31, -0.5), np.zeros(31)])
    assert seen_along(pose, scan(pose), straight, 0.2, 0.3) == math.inf
    beyond = np.column_stack([np.linspace(0.0, 4.0, 81), np.full(81, -0.5), np.zeros(81)])
    assert abs(seen_along(pose, scan(pose), beyond, 0.2, 0.3) - 1.7) < 0.2
