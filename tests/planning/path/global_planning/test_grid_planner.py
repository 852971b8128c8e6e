"""Paths for a body through maps with known passages, and the reasons why there is none."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.planning.map.layered_map import LayeredMap
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.map.zone import Zone
from robotctl.planning.map.zones import Closed
from robotctl.planning.path.global_planning.plan import Plan, PlanFailure, PlannerConfig, Reason
from robotctl.planning.path.global_planning.planners import PLANNERS

SIDE_M = 0.05
LONG = Footprint(((0.45, -0.15), (0.45, 0.15), (-0.45, 0.15), (-0.45, -0.15)))
SMALLER = Footprint(((0.44, -0.14), (0.44, 0.14), (-0.44, 0.14), (-0.44, -0.14)))
"""By more than a corner moves between two poses at which the body is checked."""


def room(width_m=6.0, height_m=4.0):
    """Return the cells of a room with walls around."""
    cells = np.zeros((round(height_m / SIDE_M), round(width_m / SIDE_M)), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    return cells


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_with_an_arm_to_one_side_only_that_side_needs_the_room(side):
    body = ((0.25, -0.5), (0.25, 0.15), (-0.25, 0.15), (-0.25, -0.15))
    with_arm = Footprint(tuple((x, side * y) for x, y in body[:: int(side)]))
    space = PlanningMap(GridMap(room(), SIDE_M), with_arm)
    start, heading = SE2(1.0, 2.0), 0.0 if side > 0.0 else math.pi
    # Along the upper wall: with the arm towards the room, and then the other way round.
    free, against = SE2(4.0, 3.7, heading), SE2(4.0, 3.7, math.pi - heading)
    planner = PLANNERS["hybrid"](PlannerConfig(turning_radius_m=0.3))
    assert isinstance(planner.plan(space, start, free), Plan)
    failure = planner.plan(space, start, against)
    assert isinstance(failure, PlanFailure)
    assert failure.reason is Reason.GOAL_BLOCKED


def two_rooms(door_m):
    """Return a room with a wall across at x = 3 m, and a door in it about y = 2 m."""
    cells = room()
    cells[:, 60] = 100
    half = round(0.5 * door_m / SIDE_M)
    cells[40 - half : 40 + half, 60] = 0
    return cells


def planned(cells, start, goal, body=LONG, planner="astar", config=None, **kwargs):
    """Plan, and check that no pose on the way lets the body touch anything.

    Arcs are of 0.5 m at least, the default: only near an end where the body cannot turn.
    """
    space = PlanningMap(GridMap(cells, SIDE_M), body, **kwargs)
    answer = PLANNERS[planner](config or PlannerConfig()).plan(space, SE2(*start), SE2(*goal))
    if isinstance(answer, Plan):
        smaller = PlanningMap(space.grid, SMALLER, **kwargs)
        assert answer.poses[0] == pytest.approx(start)
        assert answer.poses[-1] == pytest.approx(goal)
        for a, b in pairwise(answer.poses):
            turn = math.remainder(b[2] - a[2], math.tau)
            moved = math.dist(a[:2], b[:2])
            bends = moved <= 2.0 * SIDE_M and abs(turn) <= 2.0 * math.asin(moved) + 1e-6
            assert moved < 1e-9 or abs(turn) < 1e-9 or bends, "straight, on the spot, or on an arc"
            count = 2 + int(moved / 0.01 + abs(turn) / 0.02)
            between = a + np.linspace(0.0, 1.0, count)[:, np.newaxis] * (*(b - a)[:2], turn)
            in_cells = between / (SIDE_M, SIDE_M, 1.0)
            assert not smaller.collides(in_cells).any()
    return answer


def test_a_long_robot_passes_lengthwise_where_it_could_not_turn():
    plan = planned(two_rooms(0.6), (1.5, 2.0, 0.0), (4.5, 2.0, 0.0))
    assert isinstance(plan, Plan)
    assert plan.length_m == pytest.approx(3.0, abs=0.05)


def test_it_turns_where_there_is_room_for_it():
    plan = planned(two_rooms(0.6), (1.5, 1.0, math.pi / 2), (4.5, 3.0, math.pi))
    assert isinstance(plan, Plan)
    assert math.dist((1.5, 1.0), (4.5, 3.0)) < plan.length_m < 4.6


@pytest.mark.parametrize("planner", PLANNERS)
def test_a_door_too_narrow_is_named_with_its_place_and_what_is_missing(planner):
    failure = planned(two_rooms(0.2), (1.5, 2.0, 0.0), (4.5, 2.0, 0.0), planner=planner)
    assert isinstance(failure, PlanFailure)
    assert failure.reason is Reason.NO_PASSAGE
    assert failure.place == pytest.approx((3.0, 2.0), abs=0.12)
    assert "0.20 m wide" in failure.text
    assert "the robot needs 0.30 m: 0.10 m are missing" in failure.text


def test_the_widest_of_several_ways_is_named():
    cells = two_rooms(0.2)
    cells[10:13, 60] = 0
    failure = planned(cells, (1.5, 2.0, 0.0), (4.5, 2.0, 0.0))
    assert failure.place == pytest.approx((3.0, 2.0), abs=0.12)


def test_walls_all_around_are_told_with_the_area():
    failure = planned(two_rooms(0.0), (1.5, 2.0, 0.0), (4.5, 2.0, 0.0))
    assert failure.reason is Reason.NO_PASSAGE
    assert "closed all around" in failure.text


def test_a_goal_in_an_obstacle_and_one_beside_it_are_told_with_a_place_instead():
    cells = room()
    cells[30:50, 80:90] = 100
    inside = planned(cells, (1.5, 2.0, 0.0), (4.2, 2.0, 0.0))
    assert inside.reason is Reason.GOAL_BLOCKED
    assert "lies in an obstacle; the nearest place with room for it is" in inside.text
    beside = planned(cells, (1.5, 2.0, 0.0), (3.8, 2.0, 0.0))
    assert "is 0.20 m from an obstacle at x 4.03 m" in beside.text
    assert "the robot's body reaches 0.47 m" in beside.text
    start = planned(cells, (4.2, 2.0, 0.0), (1.5, 2.0, 0.0))
    assert start.reason is Reason.START_BLOCKED


def test_ends_off_the_map():
    cells = room()
    assert planned(cells, (9.0, 2.0, 0.0), (1.5, 2.0, 0.0)).reason is Reason.START_OFF_MAP
    failure = planned(cells, (1.5, 2.0, 0.0), (1.5, -2.0, 0.0))
    assert failure.reason is Reason.GOAL_OFF_MAP
    assert "off the map of 6.00 m x 4.00 m" in failure.text


def test_a_way_through_the_unknown_alone_is_told_and_taken_where_it_is_allowed():
    cells = room()
    cells[1:-1, 55:65] = -1
    ends = (1.5, 2.0, 0.0), (4.5, 2.0, 0.0)
    failure = planned(cells, *ends)
    assert failure.reason is Reason.ONLY_THROUGH_UNKNOWN
    assert failure.place == pytest.approx((2.78, 2.0), abs=0.1)
    assert isinstance(planned(cells, *ends, through_unknown=True), Plan)


def test_time_over_is_a_reason():
    space = PlanningMap(GridMap(np.zeros((700, 700), np.int8), SIDE_M), Footprint())
    planner = PLANNERS["dijkstra"](PlannerConfig())
    answer = planner.plan(space, SE2(1, 1, 0), SE2(33, 33, 0), lambda: False)
    assert answer.reason is Reason.OUT_OF_TIME


def test_a_path_keeps_away_from_walls_where_there_is_room():
    plan = planned(room(), (0.8, 0.8, 0.0), (5.2, 0.8, 0.0))
    near = planned(room(), (0.8, 0.8, 0.0), (5.2, 0.8, 0.0), config=PlannerConfig(comfort_weight=0))
    assert near.length_m == pytest.approx(4.4)
    assert plan.poses[:, 1].max() >= near.poses[:, 1].max()


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1))
def test_random_rooms_give_paths_that_are_free_and_reasons_that_have_a_place(seed):
    rng = np.random.default_rng(seed)
    cells = room()
    for _ in range(rng.integers(0, 14)):
        row, column = rng.integers(5, 70), rng.integers(5, 110)
        cells[row : row + rng.integers(2, 20), column : column + rng.integers(2, 20)] = 100
    ends = [(*rng.uniform((0.6, 0.6), (5.4, 3.4)), rng.uniform(-3, 3)) for _ in range(2)]
    answer = planned(cells, *ends)
    if isinstance(answer, PlanFailure):
        assert answer.place is not None
        assert answer.text
    else:
        assert answer.length_m <= answer.cost + 0.2


ZONE = ((2.5, 0.0), (3.5, 0.0), (3.5, 2.5), (2.5, 2.5))


def planned_by_zone(planner, steering, limit_m_s):
    """Plan past a zone: straight on it is 4 m, 1 m of it in the zone; round it some 6 m."""
    zones = [Zone("zone", ZONE, limit_m_s)]
    live = LayeredMap(GridMap(room(), SIDE_M), LONG, closed=Closed(zones), full_speed_m_s=1.0)
    config = PlannerConfig(comfort_weight=0.0, turning_radius_m=0.4, steering=steering)
    plan = PLANNERS[planner](config).plan(live.space(), SE2(1.0, 1.0, 0.0), SE2(5.0, 1.0, 0.0))
    assert isinstance(plan, Plan)
    poses = np.concatenate([np.linspace(a, b, 50) for a, b in pairwise(plan.poses)])
    return plan, ((np.abs(poses[:, 0] - 3.0) < 0.45) & (poses[:, 1] < 2.45)).any()


@pytest.mark.timeout(300)  # the first of them compiles
@pytest.mark.parametrize(("limit_m_s", "through"), [(0.5, True), (0.2, False)])
@pytest.mark.parametrize(
    ("planner", "steering"),
    [
        ("astar", "straight"),
        ("hybrid", "straight"),
        ("rrtstar", "straight"),
        ("rrtstar", "dubins"),
        ("rrtstar", "reeds-shepp"),
    ],
)
def test_a_path_goes_round_a_slow_zone_where_that_is_quicker(planner, steering, limit_m_s, through):
    plan, is_inside = planned_by_zone(planner, steering, limit_m_s)
    assert is_inside == through
    if through:
        assert plan.cost == pytest.approx(4.0 + 1.0 * (1.0 / limit_m_s - 1.0), abs=0.15)


@pytest.mark.timeout(300)  # the first of them compiles
@pytest.mark.parametrize("planner", PLANNERS)
@pytest.mark.parametrize("steering", ["straight", "dubins"])
def test_all_planners_keep_out_of_zones(planner, steering):
    assert not planned_by_zone(planner, steering, 0.0)[1]


CARPET = Zone("carpet", ((2.0, 2.0), (3.0, 2.0), (3.0, 3.0), (2.0, 3.0)))
"""A keep-out zone in a room of 5 m."""


def with_zone(*zones):
    """Return a map without an obstacle of its own, and the zones in it."""
    closed = Closed(zones)
    cells = np.zeros((100, 100), np.int8)
    cells[closed.cells(GridMap(cells, 0.05))] = 100
    space = PlanningMap(GridMap(cells, 0.05), SQUARE)
    space.closed = closed
    return space


SQUARE = Footprint(((0.2, -0.2), (0.2, 0.2), (-0.2, 0.2), (-0.2, -0.2)))


@pytest.mark.parametrize(
    ("goal", "reason"),
    [
        ((2.5, 2.5), "lies in the keep-out zone carpet; the nearest place"),
        ((1.9, 2.5), "is 0.05 m from the keep-out zone carpet at x 1.98 m"),
        ((4.9, 2.5), "is 0.10 m from the edge of the map at x 5.00 m, y 2.50 m"),
        ((0.0, 2.5), "is 0.00 m from the edge of the map at x 0.00 m, y 2.50 m"),
        ((2.5, 4.85), "is 0.15 m from the edge of the map at x 2.50 m, y 5.00 m"),
    ],
)
def test_a_blocked_end_names_the_zone_or_the_edge_of_the_map(goal, reason):
    answer = plan_to(with_zone(CARPET), (1.0, 1.0), goal)
    assert reason in answer.text
    back = plan_to(with_zone(CARPET), goal, (1.0, 1.0))
    assert back.reason is Reason.START_BLOCKED
    assert reason in back.text


def test_a_way_that_a_zone_closes_names_it():
    tape = Zone("tape", ((3.0, -1.0), (3.01, -1.0), (3.01, 6.0), (3.0, 6.0)))
    answer = plan_to(with_zone(tape), (1.0, 1.0), (4.5, 1.0))
    assert answer.reason is Reason.NO_PASSAGE
    assert "closed all around, at x 3.0" in answer.text
    assert answer.text.endswith("by the keep-out zone tape")


def plan_to(space, start, goal):
    planner = PLANNERS["astar"](PlannerConfig())
    return planner.plan(space, SE2(*start, 0.0), SE2(*goal, 0.0))


@settings(deadline=None, max_examples=40)
@given(
    gap_m=st.floats(0.03, 0.2),
    begin=st.tuples(st.floats(1.0, 5.0), st.floats(1.0, 3.0), st.floats(-math.pi, math.pi)),
    side_m=st.sampled_from([0.05, 0.02]),
)
def test_a_path_to_a_goal_beside_a_wall_turns_only_where_there_is_room_for_its_margin(
    gap_m, begin, side_m
):
    body, margin_m = Footprint(((0.2, -0.15), (0.2, 0.15), (-0.15, 0.15), (-0.15, -0.15))), 0.05
    cells = np.zeros((round(5.0 / side_m), round(6.0 / side_m)), np.int8)
    cells[-round(1.0 / side_m) :] = 100  # from y = 4 m on
    space = PlanningMap(GridMap(cells, side_m), body)
    goal = SE2(3.0, 4.0 - 0.15 - gap_m, 0.0)
    config = PlannerConfig(margin_m=margin_m, turning_radius_m=0.3)
    answer = PLANNERS["astar"](config).plan(space, SE2(*begin), goal)
    assert isinstance(answer, Plan)
    np.testing.assert_allclose(answer.poses[-1], [goal.x_m, goal.y_m, 0.0], atol=1e-9)
    for (ax, ay, a), (bx, by, b) in pairwise(answer.poses.tolist()):
        turn_rad = abs(math.remainder(b - a, math.tau))
        if math.dist((ax, ay), (bx, by)) < 1e-6 and turn_rad > math.radians(3.1):
            assert 4.0 - by > body.reach_m + margin_m - side_m
