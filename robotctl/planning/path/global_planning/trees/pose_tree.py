"""A tree of poses, joined by curves that a steered robot can drive."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robotctl.compiled import compiled
from robotctl.planning.path.global_planning.curves import PIECES
from robotctl.planning.path.global_planning.hybrid_search import GEAR_CHANGE
from robotctl.planning.path.global_planning.trees.motions import (
    curve_between,
    first_gear,
    last_gear,
    length_of,
)


class PoseTree(NamedTuple):
    """Poses with their parents, sorted into square buckets by place."""

    pose: NDArray[np.float64]
    """(n, 3)."""
    parent: NDArray[np.int64]
    curve: NDArray[np.float64]
    """(n, 2, 5): from the parent to here, in radii of the smallest turning circle."""
    cost: NDArray[np.float64]
    """Cost of that curve alone."""
    links: NDArray[np.int32]
    """The next pose of the same bucket, -1: none."""
    heads: NDArray[np.int32]
    """(rows, columns) of buckets: the first pose of each, -1: none."""
    size: NDArray[np.int64]
    """(1,): how many poses there are."""
    side: float
    """Side of a bucket [cells]."""


def make_pose_tree(
    shape: tuple[int, int], capacity: int, side: float, root: NDArray[np.float64]
) -> PoseTree:
    """Return a tree of one pose, (3,), for a map of (rows, columns) cells."""
    tree = PoseTree(
        np.empty((capacity, 3)),
        np.empty(capacity, np.int64),
        np.empty((capacity, 2, PIECES)),
        np.empty(capacity),
        np.empty(capacity, np.int32),
        np.full([math.ceil(each / side) + 1 for each in shape], -1, np.int32),
        np.zeros(1, np.int64),
        side,
    )
    add_pose(tree, root, -1, np.zeros((2, PIECES)), 0.0)
    return tree


@compiled
def add_pose(
    tree: PoseTree,
    pose: NDArray[np.float64],
    parent: int,
    curve: NDArray[np.float64],
    cost: float,
) -> int:
    """Add a pose and return its number; there must be room for it."""
    node = tree.size[0]
    tree.size[0] = node + 1
    tree.pose[node] = pose
    tree.parent[node], tree.cost[node] = parent, cost
    tree.curve[node] = curve
    row, column = int(pose[1] / tree.side), int(pose[0] / tree.side)
    tree.links[node] = tree.heads[row, column]
    tree.heads[row, column] = node
    return int(node)


@compiled
def cost_of(tree: PoseTree, node: int) -> float:
    """Return the cost from the root to a pose."""
    cost = 0.0
    while tree.parent[node] >= 0:
        parent = tree.parent[node]
        cost += tree.cost[node] + joint(tree, parent, tree.curve[node])
        node = parent
    return cost


@compiled
def joint(tree: PoseTree, node: int, curve: NDArray[np.float64]) -> float:
    """Return what it costs to go on from a pose with the first gear of a curve."""
    return GEAR_CHANGE if last_gear(tree.curve[node]) * first_gear(curve) < 0 else 0.0


@compiled
def nearest_pose(
    tree: PoseTree, pose: NDArray[np.float64], radius: float, gears: int
) -> tuple[int, NDArray[np.float64]]:
    """Return the pose with the shortest curve to another one, and that curve.

    No curve is shorter than the straight line, nor than its turn on the smallest circle: buckets
    are looked at ring by ring, until none of them can have a shorter curve.
    """
    rows, columns = tree.heads.shape
    row, column = int(pose[1] / tree.side), int(pose[0] / tree.side)
    best, best_length = -1, np.inf
    curve = np.zeros((2, PIECES))
    for ring in range(max(rows, columns)):
        if (ring - 1) * tree.side > best_length:
            break
        for r in range(max(row - ring, 0), min(row + ring, rows - 1) + 1):
            step = 1 if abs(r - row) == ring else max(2 * ring, 1)
            for c in range(column - ring, column + ring + 1, step):
                node = tree.heads[r, c] if 0 <= c < columns else -1
                while node >= 0:
                    if _bound(tree.pose[node], pose, radius) < best_length:
                        other = curve_between(tree.pose[node], pose, radius, gears)
                        length = length_of(other, radius)
                        if length < best_length:
                            best, best_length, curve = node, length, other
                    node = tree.links[node]
    return best, curve


@compiled
def _bound(a: NDArray[np.float64], b: NDArray[np.float64], radius: float) -> float:
    """Return a length than which no curve between two poses is shorter."""
    turn = (b[2] - a[2] + math.pi) % (2.0 * math.pi) - math.pi
    return max(math.hypot(b[0] - a[0], b[1] - a[1]), radius * abs(float(turn)))


@compiled
def poses_near(
    tree: PoseTree, pose: NDArray[np.float64], reach: float, near: NDArray[np.int64]
) -> int:
    """Collect the poses within a distance, as many as there is room for; return how many."""
    rows, columns = tree.heads.shape
    x, y, found = pose[0], pose[1], 0
    first_row, last_row = int((y - reach) / tree.side), int((y + reach) / tree.side)
    first_column, last_column = int((x - reach) / tree.side), int((x + reach) / tree.side)
    for r in range(max(first_row, 0), min(last_row, rows - 1) + 1):
        for c in range(max(first_column, 0), min(last_column, columns - 1) + 1):
            node = tree.heads[r, c]
            while node >= 0 and found < len(near):
                if math.hypot(tree.pose[node, 0] - x, tree.pose[node, 1] - y) <= reach:
                    near[found] = node
                    found += 1
                node = tree.links[node]
    return found
