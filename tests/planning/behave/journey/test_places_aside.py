"""Places out of people's way: in the open, in niches, and along a wall."""

import math

import numpy as np
import pytest
from shapely.affinity import rotate, translate
from shapely.geometry import Point, Polygon

from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.journey.places_aside import SQUEEZE_M, PlacesAside
from robotctl.planning.map.lane import Lane
from tests.planning.behave.journey.bench import BODY, Bench
from tests.planning.behave.journey.test_give_way import corridor

HEADINGS = np.linspace(-math.pi, math.pi, 24)


def body_at(x_m, y_m, heading_rad):
    """Return the robot's outline there."""
    turned = rotate(Polygon(BODY.corners), heading_rad, (0.0, 0.0), use_radians=True)
    return translate(turned, x_m, y_m)


def gap_m(lane, body):
    """Return how near a person who walks 12 m along a lane comes to a body [m]."""
    walked = [lane.after(0.05 * step) for step in range(round(12.0 / 0.05 / lane.speed_m_s))]
    return min(body.distance(Point(each.x_m, each.y_m)) for each in walked) - lane.radius_m


def places(lane, pose):
    """Return the tools of a robot in a corridor of 1 m about y = 2, and its places."""
    bench = Bench(corridor(), corridor(), start=pose)
    bench.look()
    tools = bench.pilot.tools
    return tools, PlacesAside(tools).find(lane, [lane], pose, 0.4, [])


@pytest.mark.parametrize("beside_m", [0.16, -0.16, 0.22])
@pytest.mark.parametrize("begins_m", [3.0, 13.0])
def test_who_walks_along_one_wall_passes_a_robot_at_the_other(beside_m, begins_m):
    speed = 0.9 if begins_m < 8.0 else -0.9
    lane = Lane.of(np.array([begins_m, 2.0 + beside_m, speed, 0.0, 0.22]))
    tools, goals = places(lane, SE2(8.0, 2.0, 0.0))
    at_wall = [goal for goal in goals if goal.heading_rad is not None and 5.5 < goal.x_m < 10.5]
    assert at_wall
    for goal in at_wall:
        assert abs(math.sin(goal.heading_rad)) < 1e-6
        assert tools.world.map.space().has_room_at(SE2(*goal[:3]))
        assert gap_m(lane, body_at(*goal[:3])) > SQUEEZE_M - 0.01
        assert (goal.y_m - 2.0) * beside_m < 0.0


def test_who_walks_in_the_middle_leaves_no_place_in_the_corridor():
    lane = Lane.of(np.array([14.0, 2.0, -0.5, 0.0, 0.22]))
    _, goals = places(lane, SE2(6.0, 2.0, 0.0))
    assert goals
    assert not [goal for goal in goals if 5.3 < goal.x_m < 10.7]


@pytest.mark.parametrize("x_m", [5.5, 6.5])
def test_no_heading_there_comes_into_the_lane(x_m):
    lane = Lane.of(np.array([13.5, 2.05, -0.6, 0.0, 0.22]))
    _, goals = places(lane, SE2(x_m, 2.0, 0.0))
    for goal in goals:
        headings = HEADINGS if goal.heading_rad is None else [goal.heading_rad]
        for heading_rad in headings:
            assert gap_m(lane, body_at(goal.x_m, goal.y_m, heading_rad)) > 0.0
