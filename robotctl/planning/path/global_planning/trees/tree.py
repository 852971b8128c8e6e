"""A tree of poses, joined by motions that the robot can drive."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.planning.path.global_planning.curves import PIECES
from robotctl.planning.path.global_planning.hybrid_search import GEAR_CHANGE
from robotctl.planning.path.global_planning.trees.motions import (
    STRAIGHT,
    curve_between,
    first_gear,
    last_gear,
    length_of,
)

_SIDE: Final = 8.0
"""Side of a bucket [cells]."""
_FEW: Final = 1000
"""Points that are compared one by one faster than buckets are looked through."""


class Tree(NamedTuple):
    """Poses with their parents, sorted into square buckets by place.

    A tree for straight pieces has headings 0.
    """

    pose: NDArray[np.float64]
    """(n, 3) [cells, cells, rad]."""
    parent: NDArray[np.int64]
    curve: NDArray[np.float64]
    """(n, 2, 5): from the parent to here, in radii of the smallest turning circle; (0, 2, 5) in a
    tree of straight pieces."""
    cost: NDArray[np.float64]
    """Cost of that curve alone."""
    total: NDArray[np.float64]
    """Cost from the root."""
    children: NDArray[np.int32]
    """(n, 2): the first child, and the next child of the same parent; -1: none."""
    links: NDArray[np.int32]
    """The next pose of the same bucket, -1: none."""
    heads: NDArray[np.int32]
    """(rows, columns) of buckets: the first pose of each, -1: none."""
    size: NDArray[np.int64]
    """(1,): how many poses there are."""


def make_tree(
    shape: tuple[int, int], capacity: int, root: NDArray[np.float64], steering: int
) -> Tree:
    """Return a tree of one pose, (3,), for a map of (rows, columns) cells."""
    tree = Tree(
        np.empty((capacity, 3)),
        np.empty(capacity, np.int64),
        np.empty((0 if steering == STRAIGHT else capacity, 2, PIECES)),
        np.empty(capacity),
        np.empty(capacity),
        np.empty((capacity, 2), np.int32),
        np.empty(capacity, np.int32),
        np.full([math.ceil(each / _SIDE) + 1 for each in shape], -1, np.int32),
        np.zeros(1, np.int64),
    )
    add_pose(tree, root, -1, np.zeros((2, PIECES)), 0.0)
    return tree


@compiled
def add_pose(
    tree: Tree,
    pose: NDArray[np.float64],
    parent: int,
    curve: NDArray[np.float64],
    cost: float,
) -> int:
    """Add a pose and return its number; there must be room for it."""
    node = tree.size[0]
    tree.size[0] = node + 1
    tree.pose[node] = pose
    tree.total[node] = 0.0
    tree.children[node, 0] = tree.children[node, 1] = -1
    tree.parent[node] = -1
    if parent >= 0:
        set_parent(tree, node, parent, curve, cost)
    elif len(tree.curve) > 0:
        tree.curve[node] = curve
    row, column = int(pose[1] / _SIDE), int(pose[0] / _SIDE)
    tree.links[node] = tree.heads[row, column]
    tree.heads[row, column] = node
    return int(node)


@compiled
def add_poses(tree: Tree, poses: NDArray[np.float64]) -> None:
    """Add poses (n, 3) without parents; there must be room for them."""
    none = np.zeros((2, PIECES))
    for i in range(len(poses)):
        add_pose(tree, poses[i], -1, none, 0.0)


def branch(tree: Tree, node: int) -> list[int]:
    """Return the poses from the root to one of them."""
    chain = [node]
    while tree.parent[chain[-1]] >= 0:
        chain.append(int(tree.parent[chain[-1]]))
    return chain[::-1]


@compiled
def set_parent(tree: Tree, node: int, parent: int, curve: NDArray[np.float64], cost: float) -> None:
    """Let a pose be reached from another by a curve; those behind it cost less or more by that."""
    before = tree.parent[node]
    if before >= 0:
        if tree.children[before, 0] == node:
            tree.children[before, 0] = tree.children[node, 1]
        else:
            other = tree.children[before, 0]
            while tree.children[other, 1] != node:
                other = tree.children[other, 1]
            tree.children[other, 1] = tree.children[node, 1]
    tree.parent[node], tree.cost[node] = parent, cost
    if len(tree.curve) > 0:
        tree.curve[node] = curve
    tree.children[node, 1] = tree.children[parent, 0]
    tree.children[parent, 0] = node
    at = node
    while at >= 0:
        above = tree.parent[at]
        tree.total[at] = tree.total[above] + tree.cost[at]
        if len(tree.curve) > 0:
            tree.total[at] += joint(tree, above, tree.curve[at])
        below = tree.children[at, 0]
        while below < 0 and at != node:  # on to what is behind the next child of one above
            below = tree.children[at, 1]
            at = tree.parent[at]
        at = below


@compiled
def joint(tree: Tree, node: int, curve: NDArray[np.float64]) -> float:
    """Return what it costs to go on from a pose with the first gear of a curve."""
    if len(tree.curve) == 0:
        return 0.0
    return GEAR_CHANGE if last_gear(tree.curve[node]) * first_gear(curve) < 0 else 0.0


@compiled
def nearest_pose(
    tree: Tree, pose: NDArray[np.float64], radius: float, steering: int
) -> tuple[int, NDArray[np.float64]]:
    """Return the pose with the shortest curve to another one, and that curve.

    No curve is shorter than the straight line, nor than its turn on the smallest circle: buckets
    are looked at ring by ring, until none of them can have a shorter curve.
    """
    if steering == STRAIGHT and tree.size[0] < _FEW:  # most buckets are empty
        best = _nearest_of_all(tree, pose[0], pose[1])
        return best, curve_between(tree.pose[best], pose, radius, steering)
    rows, columns = tree.heads.shape
    x, y, theta = pose
    row, column = int(y / _SIDE), int(x / _SIDE)
    best, best_length = -1, np.inf
    for ring in range(max(rows, columns)):
        if (ring - 1) * _SIDE > best_length:
            break
        for r in range(max(row - ring, 0), min(row + ring, rows - 1) + 1):
            step = 1 if abs(r - row) == ring else max(2 * ring, 1)
            for c in range(column - ring, column + ring + 1, step):
                node = tree.heads[r, c] if 0 <= c < columns else -1
                while node >= 0:
                    away_x, away_y = tree.pose[node, 0] - x, tree.pose[node, 1] - y
                    length = math.sqrt(away_x * away_x + away_y * away_y)
                    if steering != STRAIGHT and length < best_length:
                        turn = (theta - tree.pose[node, 2] + math.pi) % (2.0 * math.pi) - math.pi
                        length = radius * abs(turn)
                        if length < best_length:
                            curve = curve_between(tree.pose[node], pose, radius, steering)
                            length = length_of(curve, radius)
                    if length < best_length:
                        best, best_length = node, length
                    node = tree.links[node]
    return best, curve_between(tree.pose[best], pose, radius, steering)


@compiled
def _nearest_of_all(tree: Tree, x: float, y: float) -> int:
    """Return the point nearest to a place, by looking at each."""
    best, best_squared = 0, np.inf
    for node in range(tree.size[0]):
        squared = (tree.pose[node, 0] - x) ** 2 + (tree.pose[node, 1] - y) ** 2
        if squared < best_squared:
            best, best_squared = node, squared
    return best


@compiled
def poses_near(tree: Tree, pose: NDArray[np.float64], reach: float, near: NDArray[np.int64]) -> int:
    """Collect the poses within a distance, as many as there is room for; return how many."""
    rows, columns = tree.heads.shape
    x, y, found = pose[0], pose[1], 0
    first_row, last_row = int((y - reach) / _SIDE), int((y + reach) / _SIDE)
    first_column, last_column = int((x - reach) / _SIDE), int((x + reach) / _SIDE)
    for r in range(max(first_row, 0), min(last_row, rows - 1) + 1):
        for c in range(max(first_column, 0), min(last_column, columns - 1) + 1):
            node = tree.heads[r, c]
            while node >= 0 and found < len(near):
                away_x, away_y = tree.pose[node, 0] - x, tree.pose[node, 1] - y
                if away_x * away_x + away_y * away_y <= reach * reach:
                    near[found] = node
                    found += 1
                node = tree.links[node]
    return found
