"""Random trees for robots that steer: paths that they can drive, free by an independent check."""

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
from robotctl.planning.path.global_planning.curves import dubins, reeds_shepp
from robotctl.planning.path.global_planning.plan import Plan, PlannerConfig, Reason
from robotctl.planning.path.global_planning.planners import PLANNERS
from robotctl.planning.path.global_planning.trees.motions import (
    BACKWARD,
    BOTH,
    FORWARD,
    curve_between,
    end_of,
    length_of,
)
from robotctl.planning.path.global_planning.trees.tree import add_pose, make_tree, nearest_pose

pytestmark = pytest.mark.timeout(300)  # who comes first compiles

TREES = ("rrt", "rrt-connect", "rrtstar")
CURVES = {"dubins": dubins, "reeds-shepp": reeds_shepp}
SIDE_M, RADIUS_M = 0.05, 0.6
FRONT_M, REAR_M, HALF_M = 0.45, -0.12, 0.15
CAR = Footprint(((FRONT_M, -HALF_M), (FRONT_M, HALF_M), (REAR_M, HALF_M), (REAR_M, -HALF_M)))


def room(width_m=8.0, height_m=6.0):
    cells = np.zeros((round(height_m / SIDE_M), round(width_m / SIDE_M)), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    return cells


def boxes(seed):
    rng, cells = np.random.default_rng(seed), room()
    for _ in range(8):
        row, column = rng.integers(5, 110), rng.integers(34, 112)
        cells[row : row + rng.integers(3, 20), column : column + rng.integers(3, 16)] = 100
    return cells


def rounds(count):
    """Return what tells a planner to go on so often."""
    left = iter(range(count))
    return lambda: next(left, None) is not None


def arc(a, b, count=8):
    """Return poses on the arc from a pose to the next, in closed form."""
    turn = math.remainder(b[2] - a[2], math.tau)
    chord = complex(b[0] - a[0], b[1] - a[1])
    share = np.linspace(0.0, 1.0, count)
    if abs(turn) < 1e-9:
        along = share * chord
    else:
        along = chord * (np.exp(1j * turn * share) - 1.0) / (np.exp(1j * turn) - 1.0)
    return np.column_stack([a[0] + along.real, a[1] + along.imag, a[2] + share * turn])


def depth_m(cells, poses):
    """Return how deep corners of occupied cells lie in the body at most [m], at any pose."""
    rows, columns = np.nonzero(cells)
    corners = (
        np.concatenate(
            [np.stack([columns + dx, rows + dy], axis=1) for dx in (0, 1) for dy in (0, 1)]
        )
        * SIDE_M
    )
    deepest = -math.inf
    for x, y, theta in poses:
        away = (corners - (x, y)) @ np.array(
            [[math.cos(theta), -math.sin(theta)], [math.sin(theta), math.cos(theta)]]
        )
        inside = np.minimum.reduce(
            [FRONT_M - away[:, 0], away[:, 0] - REAR_M, HALF_M - np.abs(away[:, 1])]
        )
        deepest = max(deepest, float(inside.max()))
    return deepest


def planned(planner, steering, cells, start, goal, seed=0, goes_on=lambda: True, margin_m=0.05):
    """Plan, and check that the robot can drive what was planned."""
    config = PlannerConfig(
        turning_radius_m=RADIUS_M, steering=steering, seed=seed, margin_m=margin_m
    )
    space = PlanningMap(GridMap(cells, SIDE_M), CAR)
    answer = PLANNERS[planner](config).plan(space, SE2(*start), SE2(*goal), goes_on)
    if not isinstance(answer, Plan):
        return answer
    for pose, end in ((answer.poses[0], start), (answer.poses[-1], goal)):
        assert pose[:2] == pytest.approx(end[:2], abs=1e-6)
        assert math.remainder(pose[2] - end[2], math.tau) == pytest.approx(0.0, abs=1e-6)
    assert steering == "reeds-shepp" or not answer.reverse.any()
    driven = []
    for (a, b), reverse in zip(pairwise(answer.poses), answer.reverse, strict=True):
        chord, turn = math.dist(a[:2], b[:2]), math.remainder(b[2] - a[2], math.tau)
        assert abs(turn) <= 2.0 * math.asin(min(chord / (2.0 * RADIUS_M), 1.0)) + 1e-6
        middle = a[2] + 0.5 * turn
        ahead = (b[0] - a[0]) * math.cos(middle) + (b[1] - a[1]) * math.sin(middle)
        assert ahead == pytest.approx(-chord if reverse else chord, abs=1e-6), "it never slides"
        driven.append(arc(a, b, 4))
    # A corner of a cell may slip in between two poses at which the body was checked, this far.
    assert depth_m(cells, np.concatenate(driven)) <= 0.5 * SIDE_M
    local = SE2(*start).inverse() @ SE2(*goal)
    curve = CURVES[steering](local.x_m / RADIUS_M, local.y_m / RADIUS_M, local.theta_rad)
    assert answer.length_m >= np.abs(curve[1]).sum() * RADIUS_M - 0.02  # of chords
    return answer


@pytest.mark.parametrize("planner", TREES)
@pytest.mark.parametrize("steering", CURVES)
@settings(max_examples=4)
@given(seed=st.integers(0, 2**32 - 1))
def test_among_random_boxes_the_path_can_be_driven(planner, steering, seed):
    ends = (0.8, 3.0, 0.5), (7.2, 3.0, -0.5)
    answer = planned(planner, steering, boxes(seed), *ends, seed % 97, rounds(20))
    assert isinstance(answer, Plan) or answer.text


@pytest.mark.parametrize("planner", TREES)
@pytest.mark.parametrize("steering", CURVES)
def test_the_same_seed_gives_the_same_path_and_another_one_another(planner, steering):
    ends = (0.8, 3.0, 0.0), (7.2, 3.0, 0.0)
    cells = room()
    cells[20:100, 75:85] = 100
    first, again, other = (
        planned(planner, steering, cells, *ends, seed, rounds(15)) for seed in (1, 1, 2)
    )
    assert np.array_equal(first.poses, again.poses)
    assert not np.array_equal(first.poses, other.poses)


@pytest.mark.parametrize("planner", TREES)
def test_only_a_robot_that_may_reverse_backs_out_of_a_box_that_is_open_behind(planner):
    cells = room()
    cells[50:70, 30:45] = 100
    cells[53:67, 30:42] = 0  # 0.7 m wide, open to the left
    ends = (1.6, 3.0, 0.0), (6.0, 3.0, 0.0)
    plan = planned(planner, "reeds-shepp", cells, *ends)
    assert plan.reverse.any()
    stuck = planned(planner, "dubins", cells, *ends, goes_on=rounds(5))
    assert stuck.reason is Reason.OUT_OF_TIME


@pytest.mark.parametrize("planner", TREES)
def test_a_passage_too_narrow_and_no_time_are_reasons(planner):
    ends = (2.0, 3.0, 0.0), (6.0, 3.0, 0.0)
    cells = room()
    cells[:, 80] = 100
    cells[58:62, 80] = 0
    answer = planned(planner, "reeds-shepp", cells, *ends)
    assert answer.reason is Reason.NO_PASSAGE
    cells[40:80, 80] = 0
    cells[58:62, 80] = 100
    late = planned(planner, "dubins", cells, *ends, goes_on=lambda: False)
    assert late.reason is Reason.OUT_OF_TIME


@pytest.mark.parametrize("steering", CURVES)
def test_the_margin_is_kept_where_there_is_room_and_given_up_where_there_is_none(steering):
    cells = room()
    cells[:, 80] = 100
    cells[50:70, 80] = 0  # 1 m
    ends = (2.0, 3.0, 0.0), (6.0, 3.0, 0.0)
    for margin_m, least_m in ((0.2, 0.15), (0.6, 0.0)):
        plan = planned("rrt-connect", steering, cells, *ends, margin_m=margin_m)
        space = PlanningMap(GridMap(cells, SIDE_M), CAR)
        assert space.gaps_m(space.poses_to_cells(plan.poses)).min() >= least_m


def test_rrtstar_comes_near_the_cheapest_path():
    cells = room()
    cells[:80, 60:64] = cells[40:, 100:104] = 100
    ends = (1.0, 1.0, 0.0), (7.0, 5.0, 0.0)
    space = PlanningMap(GridMap(cells, SIDE_M), CAR)
    config = PlannerConfig(turning_radius_m=RADIUS_M, comfort_m=0.0)
    best = PLANNERS["hybrid"](config).plan(space, SE2(*ends[0]), SE2(*ends[1]))
    plan = planned("rrtstar", "dubins", cells, *ends, seed=3)
    assert 0.9 * best.cost <= plan.cost <= 1.1 * best.cost


POSES = st.tuples(st.floats(0, 50), st.floats(0, 50), st.floats(-math.pi, math.pi)).map(np.array)


@given(POSES, POSES)
def test_a_curve_in_reverse_is_one_from_the_end_to_the_beginning(a, b):
    back = curve_between(a, b, 9.0, BACKWARD)
    assert (back[1] <= 0.0).all()
    end = end_of(a, back, 9.0)
    assert end[:2] == pytest.approx(b[:2], abs=1e-6)
    assert math.remainder(end[2] - b[2], math.tau) == pytest.approx(0.0, abs=1e-6)
    assert length_of(back, 9.0) == pytest.approx(
        length_of(curve_between(b, a, 9.0, FORWARD), 9.0), abs=1e-6
    )


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.sampled_from([FORWARD, BOTH, BACKWARD]))
def test_the_nearest_pose_has_the_shortest_curve_of_all(seed, gears):
    rng = np.random.default_rng(seed)
    poses = rng.uniform((0.0, 0.0, -4.0), (100.0, 100.0, 4.0), (60, 3))
    tree = make_tree((100, 100), 60, poses[0], gears)
    for pose in poses[1:]:
        add_pose(tree, pose, 0, np.zeros((2, 5)), 0.0)
    goal = rng.uniform((0.0, 0.0, -4.0), (100.0, 100.0, 4.0))
    _, curve = nearest_pose(tree, goal, 9.0, gears)
    lengths = [length_of(curve_between(pose, goal, 9.0, gears), 9.0) for pose in poses]
    assert length_of(curve, 9.0) == pytest.approx(min(lengths))
