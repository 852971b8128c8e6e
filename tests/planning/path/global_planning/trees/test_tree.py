"""Points of a tree: the nearest one, and the costs of branches."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.planning.path.global_planning.hybrid_search import GEAR_CHANGE
from robotctl.planning.path.global_planning.trees.motions import (
    BOTH,
    STRAIGHT,
    curve_between,
)
from robotctl.planning.path.global_planning.trees.tree import (
    add_pose,
    add_poses,
    branch,
    make_tree,
    nearest_pose,
    set_parent,
)


@given(st.integers(0, 2**32 - 1), st.sampled_from([1, 2, 30, 200, 1500]))
def test_the_nearest_point_is_the_nearest_of_all(seed, count):
    rng = np.random.default_rng(seed)
    points = np.zeros((count, 3))
    points[:, :2] = rng.uniform(0.0, 50.0, (count, 2))
    tree = make_tree((50, 50), count, points[0], STRAIGHT)
    add_poses(tree, points[1:])
    for x, y in rng.uniform(0.0, 50.0, (20, 2)):
        node, _ = nearest_pose(tree, np.array([x, y, 0.0]), 1.0, STRAIGHT)
        found = points[node, :2]
        assert math.dist(found, (x, y)) == pytest.approx(
            np.hypot(*(points[:, :2] - (x, y)).T).min()
        )


@pytest.mark.parametrize("steering", [STRAIGHT, BOTH])
@given(st.integers(0, 2**32 - 1))
def test_what_a_pose_costs_is_the_sum_along_its_branch_whoever_its_parent_becomes(steering, seed):
    rng, count = np.random.default_rng(seed), 40
    poses = rng.uniform((0.0, 0.0, -3.0), (50.0, 50.0, 3.0), (count, 3))
    tree = make_tree((50, 50), count, poses[0], steering)

    def curve(a, b):
        return curve_between(poses[a], poses[b], 5.0, steering)

    for node in range(1, count):
        parent = int(rng.integers(node))
        add_pose(tree, poses[node], parent, curve(parent, node), rng.uniform(1.0, 9.0))
    for node in rng.integers(1, count, 20).tolist():
        parent = int(rng.integers(count))
        if node not in branch(tree, parent):
            set_parent(tree, node, parent, curve(parent, node), rng.uniform(1.0, 9.0))
    for node in range(count):
        chain = branch(tree, node)
        cost = tree.cost[chain[1:]].sum()
        if steering != STRAIGHT:
            pieces = [tree.curve[each][1] for each in chain[1:]]
            gears = [np.sign(piece[piece != 0.0]) for piece in pieces]
            cost += GEAR_CHANGE * sum(a[-1] != b[0] for a, b in pairwise(gears))
        assert tree.total[node] == pytest.approx(cost)
