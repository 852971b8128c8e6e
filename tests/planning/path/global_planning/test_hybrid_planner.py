"""Paths that a steered robot can drive: no sharper than its circle, and free for its body."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.path.global_planning.curves import reeds_shepp
from robotctl.planning.path.global_planning.plan import Plan, PlannerConfig, Reason
from robotctl.planning.path.global_planning.planners import PLANNERS

SIDE_M, RADIUS_M = 0.05, 0.6
CAR = Footprint(((0.45, -0.15), (0.45, 0.15), (-0.12, 0.15), (-0.12, -0.15)))
SMALLER = Footprint(((0.42, -0.12), (0.42, 0.12), (-0.09, 0.12), (-0.09, -0.12)))
CONFIG = PlannerConfig(turning_radius_m=RADIUS_M)
PLAIN = PlannerConfig(turning_radius_m=RADIUS_M, comfort_m=0.0)


def room(width_m=8.0, height_m=6.0):
    cells = np.zeros((round(height_m / SIDE_M), round(width_m / SIDE_M)), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    return cells


def planned(cells, start, goal, config=CONFIG):
    """Plan, and check that the robot can drive what was planned."""
    space = PlanningMap(GridMap(cells, SIDE_M), CAR)
    answer = PLANNERS["hybrid"](config).plan(space, SE2(*start), SE2(*goal))
    if not isinstance(answer, Plan):
        return answer
    assert answer.poses[0] == pytest.approx(start, abs=1e-6)
    assert answer.poses[-1, :2] == pytest.approx(goal[:2], abs=1e-6)
    assert math.remainder(answer.poses[-1, 2] - goal[2], math.tau) == pytest.approx(0, abs=1e-6)
    assert len(answer.reverse) == len(answer.poses) - 1
    for (a, b), reverse in zip(pairwise(answer.poses), answer.reverse, strict=True):
        chord, turn = math.dist(a[:2], b[:2]), math.remainder(b[2] - a[2], math.tau)
        assert chord <= 2.0 * SIDE_M
        assert abs(turn) <= 2.0 * math.asin(chord / (2.0 * RADIUS_M)) + 1e-6
        middle = a[2] + 0.5 * turn
        ahead = (b[0] - a[0]) * math.cos(middle) + (b[1] - a[1]) * math.sin(middle)
        assert ahead == pytest.approx(-chord if reverse else chord, abs=1e-6), "it never slides"
    in_cells = answer.poses / (SIDE_M, SIDE_M, 1.0)
    assert not PlanningMap(space.grid, SMALLER).collides(in_cells).any()
    return answer


@settings(max_examples=12)
@given(st.integers(0, 2**32 - 1))
def test_in_an_empty_room_the_path_is_about_that_of_reeds_and_shepp(seed):
    rng = np.random.default_rng(seed)
    start, goal = ((*rng.uniform((2, 2), (6, 4)), rng.uniform(-3, 3)) for _ in range(2))
    plan = planned(room(), start, goal, PLAIN)
    local = SE2(*start).inverse() @ SE2(*goal)
    curve = reeds_shepp(local.x_m / RADIUS_M, local.y_m / RADIUS_M, local.theta_rad)
    lengths_m = curve[1] * RADIUS_M
    signs = np.sign(lengths_m[lengths_m != 0.0])
    most = np.maximum(lengths_m, -2.0 * lengths_m).sum() + 0.4 * (np.diff(signs) != 0).sum()
    assert isinstance(plan, Plan)
    assert plan.length_m >= np.abs(lengths_m).sum() - 0.02  # of chords
    assert plan.cost <= 1.05 * most + 1e-6


def test_it_turns_round_in_a_dead_end_by_driving_to_and_fro():
    cells = room(6.0, 4.0)
    cells[:30] = cells[50:] = 100  # a corridor of 1 m: no room for a circle of 0.6 m
    cells[:, :60] = np.where(cells[:, :60] == 0, 0, 100)
    plan = planned(cells, (1.5, 2.0, 0.0), (1.5, 2.0, math.pi))
    assert isinstance(plan, Plan)
    assert plan.reverse.any()
    assert not plan.reverse.all()


def test_it_backs_out_of_a_box_that_is_open_behind():
    cells = room()
    cells[50:70, 30:45] = 100
    cells[53:67, 30:42] = 0  # 0.7 m wide, open to the left
    plan = planned(cells, (1.6, 3.0, 0.0), (6.0, 3.0, 0.0))
    assert isinstance(plan, Plan)
    assert plan.reverse[0]
    assert not plan.reverse[-1]


def test_a_passage_too_narrow_and_a_pocket_too_small_have_reasons():
    cells = room()
    cells[:, 80] = 100
    cells[58:62, 80] = 0
    assert planned(cells, (2.0, 3.0, 0.0), (6.0, 3.0, 0.0)).reason is Reason.NO_PASSAGE
    pocket = room()
    pocket[45:75, 90:125] = 100
    pocket[48:72, 93:122] = 0
    closed = planned(pocket, (2.0, 3.0, 0.0), (5.3, 3.0, 0.0))
    assert closed.reason is Reason.NO_PASSAGE
    assert "closed all around" in closed.text


def test_time_over_is_a_reason_and_keeps_what_was_found():
    space = PlanningMap(GridMap(room(), SIDE_M), CAR)
    ends = SE2(2.0, 3.0, 0.0), SE2(6.0, 3.0, math.pi)
    wall = room()
    wall[20:, 80] = 100
    hard = PlanningMap(GridMap(wall, SIDE_M), CAR)
    assert isinstance(PLANNERS["hybrid"](CONFIG).plan(space, *ends), Plan)
    late = PLANNERS["hybrid"](CONFIG).plan(hard, *ends, lambda: False)
    assert isinstance(late, Plan) or late.reason is Reason.OUT_OF_TIME


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1))
def test_among_random_boxes_the_path_can_be_driven(seed):
    rng = np.random.default_rng(seed)
    cells = room()
    for _ in range(10):
        row, column = rng.integers(5, 110), rng.integers(30, 120)
        cells[row : row + rng.integers(3, 20), column : column + rng.integers(3, 20)] = 100
    answer = planned(cells, (0.8, 3.0, 0.0), (7.3, 3.0, 0.0))
    point = PLANNERS["astar"](PlannerConfig(margin_m=0.0, comfort_m=0.0)).plan(
        PlanningMap(GridMap(cells, SIDE_M), Footprint()), SE2(0.8, 3.0, 0.0), SE2(7.3, 3.0, 0.0)
    )
    if isinstance(answer, Plan):
        assert answer.length_m >= 0.95 * point.length_m
    else:
        assert answer.text


def test_a_turning_radius_of_nothing_is_refused():
    with pytest.raises(ValueError, match="turning_radius_m"):
        PlannerConfig(turning_radius_m=0.0)
