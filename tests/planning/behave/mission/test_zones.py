"""Zones of a mission: where they are, what they refuse, and that what drives by plan heeds them."""

import math
from fractions import Fraction

import cv2
import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from robotctl.errors import ConfigError
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.behaviour import Status
from robotctl.planning.behave.mission.mission_file import parse_mission
from robotctl.planning.config import NavigationConfig
from robotctl.planning.map.zone import Zone
from tests.planning.behave.journey.bench import SIDE_M, Bench, room

WHOLE = st.integers(-20, 20)
POINT = st.tuples(WHOLE, WHOLE)


@given(st.lists(POINT, min_size=3, max_size=7, unique=True), POINT)
def test_a_point_is_inside_as_opencv_finds_it(corners, point):
    polygon = np.array(corners, np.float32)
    side = cv2.pointPolygonTest(polygon, (float(point[0]), float(point[1])), measureDist=False)
    assume(side != 0)  # on a side: either will do
    assert Zone("a", tuple(corners)).contains(point) == (side > 0)


def share_inside(corners, begin, end):
    """Return which share of a way lies in a triangle, exactly: clipped by one side after another.

    Cyrus, Beck 1978. Below 0: it passes by; 0: it touches.
    """
    (ax, ay), (bx, by), (cx, cy) = corners
    if (bx - ax) * (cy - ay) < (by - ay) * (cx - ax):
        corners = corners[::-1]
    first, last, most = Fraction(0), Fraction(1), Fraction(1)
    for (px, py), (qx, qy) in zip(corners, [*corners[1:], corners[0]], strict=True):
        left = [(qx - px) * (y - py) - (qy - py) * (x - px) for x, y in (begin, end)]
        if left[0] == left[1]:
            if left[0] < 0:
                return Fraction(-1)
            if left[0] == 0:  # along the side
                most = Fraction(0)
            continue
        crossing = Fraction(left[0], left[0] - left[1])
        if left[1] > left[0]:
            first = max(first, crossing)
        else:
            last = min(last, crossing)
    return min(last - first, most)


@example([(0, 0), (0, -1), (-1, -1)], (0, -1), (-2, -1))  # along a side
@example([(-10, -7), (16, 15), (-16, -12)], (0, 13), (7, 0))  # a sliver
@given(st.lists(POINT, min_size=3, max_size=3, unique=True), POINT, POINT)
def test_a_way_enters_a_triangle_where_a_point_of_it_is_inside(corners, begin, end):
    (ax, ay), (bx, by), (cx, cy) = corners
    assume((bx - ax) * (cy - ay) != (by - ay) * (cx - ax))
    zone = Zone("a", tuple(corners))
    assume(not zone.contains(begin))
    share = share_inside(corners, begin, end)
    if share > 0:
        assert zone.is_entered(begin, end)
    if share < 0:
        assert not zone.is_entered(begin, end)


MISSION = """
name = "rounds"
world = "flat"
start = { x_m = 1.0, y_m = 1.0 }

[[zone]]
name = "stairs"
corners = [[2.0, 0.5], [3.0, 0.5], [3.0, 1.5], [2.0, 1.5]]
SPEED

[[item]]
kind = "drive"
waypoints = [[1.0, 1.0], [4.0, 1.0]]

[[item]]
kind = "goto"
x_m = 2.5
y_m = 1.0

[[item]]
kind = "circle"
x_m = 2.5
y_m = 2.2
radius_m = 0.9
"""


def test_what_leads_into_a_keep_out_zone_is_refused_with_the_zone():
    with pytest.raises(ConfigError) as refused:
        parse_mission(MISSION.replace("SPEED", ""), "rounds.toml")
    first, second, third = str(refused.value).splitlines()
    assert "item[0].waypoints: lead through the keep-out zone stairs" in first
    assert "item[1].x_m: the goal is in the keep-out zone stairs" in second
    assert "item[2].radius_m: leads through the keep-out zone stairs" in third


def test_a_slow_zone_may_be_driven_through():
    (zone,) = parse_mission(MISSION.replace("SPEED", "speed_m_s = 0.2"), "rounds.toml").zone
    assert zone.speed_m_s == 0.2


@pytest.mark.parametrize("grid", [room(), None], ids=["map", "no map"])
def test_a_robot_keeps_out_of_a_zone_only_while_its_mission_is_loaded(grid):
    zone = Zone("carpet", ((2.5, 1.2), (3.5, 1.2), (3.5, 2.8), (2.5, 2.8)))
    least = []
    for zones in ((zone,), ()):
        bench = Bench(room(), grid)
        bench.pilot.use_zones(zones)
        places = []
        see = bench.pilot.see

        def note(pose, seen, now_ns, *, see=see, places=places):
            places.append((pose.x_m, pose.y_m))
            see(pose, seen, now_ns)

        bench.pilot.see = note
        assert bench.drive(5.0, 2.0).status is Status.DONE
        away = [math.dist(place, (3.0, 2.0)) for place in places]
        least.append(min(away))
        if zones:
            assert not any(zone.contains(place) for place in places)
    assert least[0] > 0.8
    assert least[1] < 2 * SIDE_M


def test_drawn_zones_count_beside_those_of_the_mission_until_they_are_wiped_out():
    bench = Bench(room(), room())
    slow = [Zone("slow", ((1.0, 0.5), (2.0, 0.5), (2.0, 1.5)), 0.2)]
    bench.pilot.use_zones(slow)
    bench.pilot.use_drawn_zones([Zone("shut", ((3.0, -1.0), (3.4, -1.0), (3.4, 9.0), (3.0, 9.0)))])
    there = SE2(1.8, 0.8, 0.0)
    assert bench.pilot.tools.world.speed_limit(there, np.zeros((1, 3))) == pytest.approx(0.2)
    stuck = bench.drive(5.0, 2.0, seconds=10.0)
    assert stuck is None or stuck.status is not Status.DONE
    assert "shut" in " ".join(bench.texts)
    bench.pilot.use_zones(())
    assert bench.pilot.tools.world.speed_limit(there, np.zeros((1, 3))) == math.inf
    bench.pilot.use_drawn_zones(())
    assert bench.drive(5.0, 2.0).status is Status.DONE


@pytest.mark.parametrize("width_m", [0.02, 1.0])
def test_a_slow_zone_is_entered_and_driven_through_at_its_speed(width_m):
    bench = Bench(room(), room())
    corners = ((3.01, 0.0), (3.01 + width_m, 0.0), (3.01 + width_m, 4.0), (3.01, 4.0))
    bench.pilot.use_zones([Zone("slow", corners, 0.2)])
    inside, elsewhere = [], []

    def note(bench):
        within = 3.0 <= bench.pose.x_m < 3.05 + width_m
        (inside if within else elsewhere).append(bench.twist.v_m_s)

    assert bench.drive(5.0, 2.0, each=note).status is Status.DONE
    assert max(inside) < 0.22
    assert max(elsewhere) > 0.7
    bench.pilot.use_zones([])
    assert bench.pilot.tools.world.speed_limit(SE2(3.02, 2.0, 0.0), np.zeros((1, 3))) == math.inf


def test_the_speed_before_a_slow_zone_is_what_braking_takes_away_on_the_path():
    bench = Bench(room(), room())
    bench.pilot.use_zones([Zone("end", ((5, 0), (6, 0), (6, 4), (5, 4)), 0.2)])
    path = np.column_stack([np.arange(1.0, 5.5, 0.01), np.full(450, 2.0), np.zeros(450)])
    braking_m_s2 = NavigationConfig().pursuit.acceleration_m_s2
    for away_m in (0.0, 0.5, 2.0):
        here = SE2(5.0 - away_m, 2.0, 0.0)
        rest = path[path[:, 0] >= here.x_m]
        expected_m_s = math.sqrt(0.2**2 + 2.0 * braking_m_s2 * away_m)
        # Cells that the zone touches begin up to one before it.
        assert bench.pilot.tools.world.speed_limit(here, rest) == pytest.approx(
            expected_m_s, abs=0.06
        )
