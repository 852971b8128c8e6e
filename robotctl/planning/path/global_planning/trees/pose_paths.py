"""Paths through trees of poses: the poses along their curves, and cheaper curves between them."""

from __future__ import annotations

import itertools
import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.planning.path.global_planning.curves import along
from robotctl.planning.path.global_planning.hybrid_search import GEAR_CHANGE, REVERSE
from robotctl.planning.path.global_planning.trees.motions import (
    Course,
    curve_between,
    drive_along,
    first_gear,
    last_gear,
)
from robotctl.planning.path.global_planning.trees.tree import Tree, branch

_SPACING: Final = 1.0
"""Spacing of the poses of a path [cells]."""


class PosePath(NamedTuple):
    """Poses close to each other: from each to the next the robot drives an arc or straight."""

    poses: NDArray[np.float64]
    """(n, 3) [cells, cells, rad]."""
    gears: NDArray[np.int64]
    """(n,): of the piece that leads to each, 1 or -1; 0 for the first."""


def path_from_root(tree: Tree, node: int, radius: float) -> PosePath:
    """Return the path along the curves from the root to a pose."""
    chain = branch(tree, node)
    poses, gears = [tree.pose[chain[0]][np.newaxis]], [np.zeros(1, np.int64)]
    for parent, child in itertools.pairwise(chain):
        piece, gear = _placed(tree.pose[parent], tree.curve[child], radius)
        piece[-1] = tree.pose[child]
        poses.append(piece[1:])
        gears.append(gear[1:])
    return PosePath(np.concatenate(poses), np.concatenate(gears))


def backwards(path: PosePath) -> PosePath:
    """Return the path from its end to its beginning, in the opposite gears."""
    gears = np.concatenate([np.zeros(1, np.int64), -path.gears[:0:-1]])
    return PosePath(path.poses[::-1].copy(), gears)


def joined(first: PosePath, second: PosePath) -> PosePath:
    """Return two paths in one; the second begins where the first ends."""
    return PosePath(
        np.concatenate([first.poses, second.poses[1:]]),
        np.concatenate([first.gears, second.gears[1:]]),
    )


@compiled
def _placed(
    start: NDArray[np.float64], curve: NDArray[np.float64], radius: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the poses along a curve from a pose on, (n, 3), and the gear to each, (n,)."""
    poses, gears = along(curve, radius, _SPACING)
    c, s = math.cos(start[2]), math.sin(start[2])
    for i in range(len(poses)):
        x, y = poses[i, 0], poses[i, 1]
        poses[i, 0], poses[i, 1] = start[0] + c * x - s * y, start[1] + s * x + c * y
        poses[i, 2] += start[2]
    return poses, gears.astype(np.int64)


@compiled
def cost_along(
    poses: NDArray[np.float64], gears: NDArray[np.int64], prices: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the cost from the first of poses to each, (n,)."""
    cost, is_priced = np.zeros(len(poses)), len(prices) > 0
    for i in range(1, len(poses)):
        x, y = poses[i, 0], poses[i, 1]
        step = math.hypot(x - poses[i - 1, 0], y - poses[i - 1, 1])
        step *= (prices[int(y), int(x)] if is_priced else 1.0) * (1.0 if gears[i] > 0 else REVERSE)
        cost[i] = cost[i - 1] + step + _change(gears[i - 1], gears[i])
    return cost


@compiled
def _change(before: int, after: int) -> float:
    """Return what it costs to change from a gear to another."""
    return GEAR_CHANGE if before * after < 0 else 0.0


@compiled
def shorten_poses(
    poses: NDArray[np.float64],
    gears: NDArray[np.int64],
    course: Course,
    rng: np.random.Generator,
    tries: int,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return a path with random parts of it replaced by curves that are free and cost less."""
    cost = cost_along(poses, gears, course.prices)
    for _ in range(tries):
        count = len(poses)
        i, j = int(rng.random() * count), int(rng.random() * count)
        i, j = min(i, j), max(i, j)
        if j - i < 2:
            continue
        curve = curve_between(poses[i], poses[j], course.radius, course.steering)
        after = int(gears[j + 1]) if j + 1 < count else 0
        old = cost[j] - cost[i] + _change(gears[j], after)
        new = _change(gears[i], first_gear(curve)) + _change(last_gear(curve), after)
        if new >= old:
            continue
        way, price = drive_along(course, poses[i], curve, np.inf)
        if way < np.inf or new + price >= old - 1e-3:
            continue
        piece, gear = _placed(poses[i], curve, course.radius)
        last = len(piece) - 1  # the end of the curve, which is the pose j but for rounding
        poses = np.concatenate((poses[: i + 1], piece[1:last], poses[j:]))
        gears = np.concatenate((gears[: i + 1], gear[1:last], gear[last:], gears[j + 1 :]))
        cost = cost_along(poses, gears, course.prices)
    return poses, gears
