"""Random trees: paths that are free by an independent walk, seeds, and nearness to the optimum."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.planning.map.planning_map import PlanningMap, clearance_of
from robotctl.planning.path.global_planning.plan import Plan, PlannerConfig, Reason
from robotctl.planning.path.global_planning.planners import PLANNERS
from robotctl.planning.path.global_planning.trees.motions import (
    free_share,
)
from robotctl.planning.path.global_planning.trees.point_paths import shorten

TREES = ("rrt", "rrt-connect", "rrtstar")
POINT = PlannerConfig(margin_m=0.0, comfort_m=0.0)
ROBOT = Footprint(((0.25, -0.15), (0.25, 0.15), (-0.15, 0.15), (-0.15, -0.15)))
SMALLER = Footprint(((0.24, -0.14), (0.24, 0.14), (-0.14, 0.14), (-0.14, -0.14)))
"""By more than a corner moves between two poses at which the body is checked."""


def test_a_path_is_shortened_and_stays_free():
    blocked = np.zeros((40, 40), bool)
    blocked[10:, 20] = True
    clearance = clearance_of(blocked)
    path = np.array([(2.5, 35.5), (5.5, 3.5), (10.5, 8.5), (20.5, 2.5), (39.0, 3.0), (35.5, 35.5)])
    short = shorten(path, clearance, 0.0, np.empty((0, 0)), np.random.default_rng(0), 400)
    assert (short[0] == path[0]).all()
    assert (short[-1] == path[-1]).all()
    for a, b in pairwise(short):
        assert free_share(clearance, 0.0, *a, *b) == 1.0
    best = math.dist((2.5, 35.5), (20, 10)) + 1.0 + math.dist((21, 10), (35.5, 35.5))
    assert best <= np.hypot(*np.diff(short, axis=0).T).sum() <= 1.1 * best


def walls(seed):
    """Return a room with random boxes."""
    rng = np.random.default_rng(seed)
    cells = np.zeros((120, 160), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    for _ in range(14):
        row, column = rng.integers(10, 100), rng.integers(20, 110)
        cells[row : row + rng.integers(3, 30), column : column + rng.integers(3, 30)] = 100
    return cells


@pytest.mark.parametrize("planner", TREES)
@settings(max_examples=15)
@given(seed=st.integers(0, 2**32 - 1))
def test_paths_are_free_for_the_body_and_no_shorter_than_the_straight_line(planner, seed):
    space = PlanningMap(GridMap(walls(seed), 0.05), ROBOT)
    start, goal = SE2(0.4, 3.0, 1.0), SE2(7.6, 3.0, -2.0)
    answer = PLANNERS[planner](PlannerConfig(seed=seed % 97)).plan(space, start, goal)
    point = PlanningMap(space.grid, Footprint())
    other = PLANNERS["astar"](POINT).plan(point, start, goal)
    if not isinstance(answer, Plan):
        assert answer.reason in (Reason.NOT_FOUND, Reason.NO_PASSAGE)
        assert answer.text
        return
    assert answer.length_m >= math.dist((0.4, 3.0), (7.6, 3.0)) - 1e-9
    if isinstance(other, Plan):
        assert answer.length_m >= 0.9 * other.length_m
    for a, b in pairwise(answer.poses):
        turn = math.remainder(b[2] - a[2], math.tau)
        share = np.linspace(0.0, 1.0, 400)[:, np.newaxis]
        poses = (a + share * (*(b - a)[:2], turn)) / (0.05, 0.05, 1.0)
        assert not PlanningMap(space.grid, SMALLER).collides(poses).any()


@pytest.mark.parametrize("planner", TREES)
def test_the_same_seed_gives_the_same_path_and_another_one_another(planner):
    space = PlanningMap(GridMap(walls(5), 0.05), ROBOT)
    ends = SE2(0.4, 3.0, 0.0), SE2(7.6, 3.0, 0.0)
    first, again, other = (
        PLANNERS[planner](PlannerConfig(seed=seed)).plan(space, *ends) for seed in (1, 1, 2)
    )
    assert np.array_equal(first.poses, again.poses)
    assert not np.array_equal(first.poses, other.poses)


@pytest.mark.parametrize("planner", TREES)
def test_a_door_of_one_cell_between_rooms_is_found(planner):
    cells = np.zeros((200, 200), np.int8)
    cells[:, 100] = 100
    cells[17, 100] = 0
    space = PlanningMap(GridMap(cells, 1.0), Footprint())
    answer = PLANNERS[planner](POINT).plan(space, SE2(50.5, 150.5, 0), SE2(150.5, 150.5, 0))
    best = 2.0 * math.dist((50.5, 150.5), (100.0, 18.0))
    assert best - 2.0 <= answer.length_m <= 1.3 * best


def test_a_tree_that_is_optimal_comes_near_the_shortest_path():
    cells = np.zeros((200, 200), np.int8)
    cells[40:160, 100] = 100
    space = PlanningMap(GridMap(cells, 1.0), Footprint())
    answer = PLANNERS["rrtstar"](POINT).plan(space, SE2(50.5, 100.5, 0), SE2(150.5, 100.5, 0))
    best = math.dist((50.5, 100.5), (100, 160)) + 1.0 + math.dist((101, 160), (150.5, 100.5))
    assert best <= answer.length_m <= 1.01 * best


@pytest.mark.parametrize("planner", TREES)
def test_paths_through_many_rooms_are_near_the_shortest(planner):
    rng = np.random.default_rng(3)
    cells = np.zeros((129, 129), np.int8)
    cells[::16] = cells[:, ::16] = 100
    for k in range(16, 128, 16):  # a door of one cell in each wall of each room
        for at in range(0, 128, 16):
            cells[k, at + rng.integers(2, 14)] = cells[at + rng.integers(2, 14), k] = 0
    space = PlanningMap(GridMap(cells, 1.0), Footprint())
    ends = SE2(8.5, 8.5, 0.0), SE2(120.5, 120.5, 0.0)
    best = PLANNERS["astar"](POINT).plan(space, *ends).length_m
    for seed in range(3):
        answer = PLANNERS[planner](PlannerConfig(0.0, 0.0, seed=seed)).plan(space, *ends)
        assert 0.92 * best <= answer.length_m <= 1.3 * best


@pytest.mark.parametrize("planner", TREES)
def test_no_time_and_no_way_are_reasons(planner):
    cells = walls(3)
    space = PlanningMap(GridMap(cells, 0.05), ROBOT)
    ends = SE2(0.4, 3.0, 0.0), SE2(7.6, 3.0, 0.0)
    late = PLANNERS[planner](PlannerConfig()).plan(space, *ends, lambda: False)
    assert late.reason is Reason.OUT_OF_TIME
    cells[:, 80] = 100
    closed = PlanningMap(GridMap(cells, 0.05), ROBOT)
    answer = PLANNERS[planner](PlannerConfig()).plan(closed, *ends)
    assert answer.reason is Reason.NO_PASSAGE
    assert "closed all around" in answer.text
