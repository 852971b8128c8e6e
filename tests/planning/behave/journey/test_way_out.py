"""Starts where the robot should not be: in a keep-out zone, beyond the fence, close to a wall."""

import itertools
import math

import numpy as np
import pytest

from robotctl.model.fence import Fence, FenceCircle, FencePolygon
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.behaviour import Status
from robotctl.planning.config import NavigationConfig, PilotConfig
from robotctl.planning.map.zone import Zone
from robotctl.planning.path.global_planning.goal import Goal
from robotctl.planning.path.global_planning.plan import Plan
from tests.planning.behave.journey.bench import BODY, SIDE_M, Bench, room

PEN = Zone("pen", ((0.5, 1.2), (2.0, 1.2), (2.0, 2.8), (0.5, 2.8)))
"""Around `START`: 1 m to its front side, less to others."""


def with_zones(*zones, grid=None, start=SE2(1.0, 2.0, 0.0)):  # noqa: B008
    config = NavigationConfig(pilot=PilotConfig(zone=zones))
    return Bench(room(), grid, start=start, config=config)


def way_in(bench, zone, end):
    """Return how long the way of a drive in a zone was [m]; it must not come back."""
    places = []
    assert bench.drive(*end, each=lambda b: places.append((b.pose.x_m, b.pose.y_m))) is not None
    inside = [zone.contains(place) for place in places]
    last = max(np.flatnonzero(inside))
    assert all(inside[: last + 1]), "it came back"
    return sum(math.dist(a, b) for a, b in itertools.pairwise(places[:last]))


@pytest.mark.parametrize("grid", [room(), None], ids=["map", "no map"])
def test_out_of_a_keep_out_zone_it_drives_the_shortest_way_and_names_it(grid):
    bench = with_zones(PEN, grid=grid)
    way_m = way_in(bench, PEN, (5.0, 2.0))
    assert math.dist((bench.pose.x_m, bench.pose.y_m), (5.0, 2.0)) < 0.06
    assert 0.7 < way_m < 1.3
    assert any("out of the keep-out zone pen" in text for text in bench.texts)
    assert "out of" not in bench.texts[-2]


def test_the_way_out_leads_to_the_nearest_side_and_not_towards_the_goal():
    deep = Zone("deep", ((0.5, 1.7), (5.0, 1.7), (5.0, 3.9), (0.5, 3.9)))
    bench = with_zones(deep, grid=room(), start=SE2(1.5, 2.1, 0.0))
    bench.look()
    plan = bench.pilot.tools.paths.plan(bench.pose, Goal(5.4, 3.0))
    assert isinstance(plan, Plan)
    end_m = plan.poses[-1, :2]
    assert end_m[1] < 1.7 - BODY.inscribed_m
    assert plan.length_m < 1.0


def test_a_goal_in_the_zone_is_refused_though_the_robot_stands_in_it():
    end = with_zones(PEN, grid=room()).drive(1.5, 2.0)
    assert end.status is Status.FAILED
    assert "the goal at x 1.50 m, y 2.00 m lies in the keep-out zone pen" in end.text


def test_once_out_it_is_kept_out_again():
    bench = with_zones(PEN, grid=room())
    bench.drive(5.0, 2.0)
    bench.look()
    plan = bench.pilot.tools.paths.plan(bench.pose, Goal(0.4, 0.4))
    assert isinstance(plan, Plan)
    assert not any(PEN.contains((x, y)) for x, y, _ in plan.poses)


def test_beyond_the_fence_it_drives_in():
    bench = Bench(room(), room(), start=SE2(1.0, 2.0, 0.0))
    inside = FencePolygon(((1.5, 0.0), (6.0, 0.0), (6.0, 4.0), (1.5, 4.0)), keeps_in=True)
    bench.pilot.use_fence(Fence((inside,)))
    assert bench.drive(5.0, 2.0).status is Status.DONE
    assert any("out of the fence" in text for text in bench.texts)


def test_a_hole_of_the_fence_without_another_place_is_told():
    bench = Bench(room(), room(), start=SE2(1.0, 2.0, 0.0))
    bench.pilot.use_fence(Fence((), (FenceCircle(3.0, 2.0, 9.0, False),)))
    end = bench.drive(5.0, 2.0)
    assert end.status is Status.FAILED
    assert "fence" in end.text


NOSE, TAIL = max(x for x, _ in BODY.corners), -min(x for x, _ in BODY.corners)
ASIDE = max(y for _, y in BODY.corners)
WALL_M = SIDE_M
"""The walls of the room are one cell thick."""


@pytest.mark.parametrize("gap_m", [0.005, 0.03])
@pytest.mark.parametrize(
    "start",
    [
        lambda gap: SE2(2.0, WALL_M + ASIDE + gap, 0.0),
        lambda gap: SE2(2.0, 4.0 - WALL_M - ASIDE - gap, 0.0),
        lambda gap: SE2(WALL_M + NOSE + gap, 2.0, math.pi),
        lambda gap: SE2(WALL_M + TAIL + gap, 2.0, 0.0),
        lambda gap: SE2(WALL_M + TAIL + gap, WALL_M + ASIDE + gap, 0.0),
    ],
    ids=["right", "left", "nose", "tail", "corner"],
)
def test_a_robot_close_to_a_wall_drives_off(gap_m, start):
    bench = Bench(room(), room(), start=start(gap_m))
    assert bench.drive(5.0, 2.0, seconds=40.0).status is Status.DONE
    assert bench.pilot.recoveries == 0


def test_without_a_map_it_leads_out_of_a_zone_also_after_the_map_has_grown():
    """What closes there was compared with the map of the start, which was smaller by then."""
    far = Zone("far", ((40.0, 1.0), (43.0, 1.0), (43.0, 3.0), (40.0, 3.0)))
    bench = with_zones(far, start=SE2(2.0, 2.0, 0.0))
    bench.world = room(width_m=60.0)
    bench.look()
    for x_m in range(3, 44, 3):
        bench.pose = SE2(float(x_m), 2.0, 0.0)
        bench.now_ns += 100_000_000
        bench.look()
    plan = bench.pilot.tools.paths.plan(bench.pose, Goal(50.0, 2.0))
    assert isinstance(plan, Plan)
    assert not far.contains(tuple(plan.poses[-1, :2]))
