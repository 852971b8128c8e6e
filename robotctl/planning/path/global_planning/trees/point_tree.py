"""Trees of points that grow over a map: nearest points, lines of sight, and growth.

RRT: LaValle, "Rapidly-exploring random trees", 1998. RRT-Connect: Kuffner and LaValle 2000. RRT*:
Karaman and Frazzoli 2011; informed samples: Gammell, Srinivasa, Barfoot 2014. All lengths are in
cells of the map. A cell is passable where its clearance is at least the robot's radius, and a piece
is where all cells that it touches are.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robotctl.compiled import compiled
from robotctl.planning.path.global_planning.smoothing import line

FOUND, GOING_ON, FULL = 2, 1, 0
_LEAST_STEP: Final = 0.25
"""A piece that is shorter brings nothing [cells]."""
_FEW: Final = 1000
"""Points that are compared one by one faster than buckets are looked through."""
_ROOM: Final = 0.93
"""Maximum distance from a point to its cell's centre, plus the error of the clearance [cells]."""


class Tree(NamedTuple):
    """Points with their parents, sorted into square buckets by place."""

    xy: NDArray[np.float64]
    parent: NDArray[np.int32]
    cost: NDArray[np.float64]
    """Length from the root."""
    links: NDArray[np.int32]
    """The next point of the same bucket, -1: none."""
    heads: NDArray[np.int32]
    """(rows, columns) of buckets: the first point of each, -1: none."""
    size: NDArray[np.int64]
    """(1,): how many points there are."""


def make_tree(
    shape: tuple[int, int], capacity: int, side: float, root: tuple[float, float]
) -> Tree:
    """Return a tree of one point, for a map of (rows, columns) cells."""
    buckets = tuple(math.ceil(each / side) + 1 for each in shape)
    tree = Tree(
        np.empty((capacity, 2)),
        np.empty(capacity, np.int32),
        np.empty(capacity),
        np.empty(capacity, np.int32),
        np.full(buckets, -1, np.int32),
        np.zeros(1, np.int64),
    )
    add_point(tree, side, root[0], root[1], -1, 0.0)
    return tree


@compiled
def add_point(tree: Tree, side: float, x: float, y: float, parent: int, cost: float) -> int:
    """Add a point and return its number; there must be room for it."""
    node = tree.size[0]
    tree.size[0] = node + 1
    tree.xy[node, 0], tree.xy[node, 1] = x, y
    tree.parent[node], tree.cost[node] = parent, cost
    row, column = int(y / side), int(x / side)
    tree.links[node] = tree.heads[row, column]
    tree.heads[row, column] = node
    return int(node)


@compiled
def add_points(tree: Tree, side: float, points: NDArray[np.float64]) -> None:
    """Add points (n, 2) without parents; there must be room for them."""
    for i in range(len(points)):
        add_point(tree, side, points[i, 0], points[i, 1], -1, 0.0)


@compiled
def nearest_point(tree: Tree, side: float, x: float, y: float) -> int:
    """Return the point nearest to a place: rings of buckets around it, until none can be nearer."""
    if tree.size[0] < _FEW:  # most buckets are empty
        return _nearest_of_all(tree, x, y)
    rows, columns = tree.heads.shape
    best, best_squared = -1, np.inf
    row, column = int(y / side), int(x / side)
    for ring in range(max(rows, columns)):
        if best >= 0 and ((ring - 1) * side) ** 2 > best_squared:
            break
        for r in range(max(row - ring, 0), min(row + ring, rows - 1) + 1):
            edge = abs(r - row) == ring
            step = 1 if edge else max(2 * ring, 1)
            for c in range(column - ring, column + ring + 1, step):
                if not 0 <= c < columns:
                    continue
                node = tree.heads[r, c]
                while node >= 0:
                    squared = (tree.xy[node, 0] - x) ** 2 + (tree.xy[node, 1] - y) ** 2
                    if squared < best_squared:
                        best, best_squared = node, squared
                    node = tree.links[node]
    return best


@compiled
def _nearest_of_all(tree: Tree, x: float, y: float) -> int:
    """Return the point nearest to a place, by looking at each."""
    best, best_squared = 0, np.inf
    for node in range(tree.size[0]):
        squared = (tree.xy[node, 0] - x) ** 2 + (tree.xy[node, 1] - y) ** 2
        if squared < best_squared:
            best, best_squared = node, squared
    return best


@compiled
def free_share(
    clearance: NDArray[np.float32], radius: float, x0: float, y0: float, x1: float, y1: float
) -> float:
    """Return which share of a straight piece is free from its start on, up to 1.

    Where the clearance is large the next cells need not be looked at. Else cells are visited in
    order (Amanatides and Woo 1987); a corner that is passed exactly needs both cells beside it.
    """
    rows, columns = clearance.shape
    dx, dy = x1 - x0, y1 - y0
    length = np.hypot(dx, dy)
    right, up = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    step_x = abs(1.0 / dx) if dx != 0.0 else np.inf
    step_y = abs(1.0 / dy) if dy != 0.0 else np.inf
    at, column, row, next_x, next_y = 0.0, 0, 0, 0.0, 0.0
    jumped = True
    while True:
        if jumped:  # where is the piece now, and when does it leave this cell?
            column, row = int(np.floor(x0 + at * dx)), int(np.floor(y0 + at * dy))
            next_x = (column + (dx > 0) - x0) / dx if dx != 0.0 else np.inf
            next_y = (row + (dy > 0) - y0) / dy if dy != 0.0 else np.inf
        if not (0 <= row < rows and 0 <= column < columns) or clearance[row, column] < radius:
            return at
        jump = clearance[row, column] - radius - _ROOM
        jumped = jump > 2.0
        if jumped:
            at += jump / length
        else:
            at = min(next_x, next_y)
        if at >= 1.0 or length == 0.0:
            return 1.0
        if jumped:
            continue
        if abs(next_x - next_y) * length < 1e-9:
            beside = 0 <= column + right < columns and clearance[row, column + right] >= radius
            above = 0 <= row + up < rows and clearance[row + up, column] >= radius
            if not (beside and above):
                return at
            column += right
            row += up
            next_x += step_x
            next_y += step_y
        elif next_x < next_y:
            column += right
            next_x += step_x
        else:
            row += up
            next_y += step_y


@compiled
def price_of(prices: NDArray[np.float64], x0: float, y0: float, x1: float, y1: float) -> float:
    """Return the cost of a straight piece: its length, in zones so many times longer.

    Parameters
    ----------
    prices
        (rows, columns): what a unit of length costs, at least 1; (0, 0): 1 everywhere.
    """
    if len(prices) == 0:
        return math.hypot(x1 - x0, y1 - y0)
    cost, _ = line(prices, prices, x0, y0, x1, y1)  # nearness to walls is asked elsewhere
    return float(cost)


@compiled
def grow(
    tree: Tree,
    side: float,
    clearance: NDArray[np.float32],
    radius: float,
    x: float,
    y: float,
    longest: float,
) -> tuple[int, bool]:
    """Grow from the nearest point towards a place; return the new point, and whether it is there.

    -1 where nothing could grow.
    """
    near = nearest_point(tree, side, x, y)
    x0, y0 = tree.xy[near, 0], tree.xy[near, 1]
    length = np.hypot(x - x0, y - y0)
    if length < 1e-9:
        return near, True
    share = min(1.0, longest / length)
    x1, y1 = x0 + share * (x - x0), y0 + share * (y - y0)
    free = free_share(clearance, radius, x0, y0, x1, y1)
    if free < 1.0:
        # Half a cell back from the wall, in a cell that is passable for sure.
        free -= 0.5 / (share * length)
        if free * share * length < _LEAST_STEP:
            return -1, False
        x1, y1 = x0 + free * share * (x - x0), y0 + free * share * (y - y0)
    node = add_point(tree, side, x1, y1, near, tree.cost[near] + np.hypot(x1 - x0, y1 - y0))
    return node, free >= 1.0 and share >= 1.0


@compiled
def sample(
    rng: np.random.Generator,
    free: NDArray[np.int32],
    narrow: NDArray[np.int32],
    narrow_share: float,
) -> tuple[float, float]:
    """Return a random place in a free cell, or with some share in one of a narrow passage."""
    if len(narrow) > 0 and rng.random() < narrow_share:
        cell = narrow[int(rng.random() * len(narrow))]
    else:
        cell = free[int(rng.random() * len(free))]
    return cell[1] + rng.random(), cell[0] + rng.random()


@compiled
def grow_single(
    tree: Tree,
    side: float,
    clearance: NDArray[np.float32],
    radius: float,
    goal: tuple[float, float],
    free: NDArray[np.int32],
    narrow: NDArray[np.int32],
    rng: np.random.Generator,
    longest: float,
    rounds: int,
) -> tuple[int, int]:
    """RRT: grow for some rounds; return the state, and the point that sees the goal."""
    for _ in range(rounds):
        if tree.size[0] + 2 > len(tree.parent):
            return FULL, -1
        x, y = goal if rng.random() < 0.05 else sample(rng, free, narrow, 0.3)
        node, _ = grow(tree, side, clearance, radius, x, y, longest)
        if node < 0:
            continue
        x, y = tree.xy[node, 0], tree.xy[node, 1]
        near = np.hypot(goal[0] - x, goal[1] - y) <= longest
        if near and free_share(clearance, radius, x, y, goal[0], goal[1]) >= 1.0:
            return FOUND, node
    return GOING_ON, -1


@compiled
def grow_both(
    trees: tuple[Tree, Tree],
    side: float,
    clearance: NDArray[np.float32],
    radius: float,
    free: NDArray[np.int32],
    narrow: NDArray[np.int32],
    rng: np.random.Generator,
    longest: float,
    rounds: int,
) -> tuple[int, int, int]:
    """RRT-Connect: grow one tree, let the other grow to the new point, take turns.

    Return the state, and the points of both trees that met.
    """
    for turn in range(rounds):
        one, other = (trees[0], trees[1]) if turn % 2 == 0 else (trees[1], trees[0])
        if one.size[0] + 2 > len(one.parent) or other.size[0] + 2 > len(other.parent):
            return FULL, -1, -1
        x, y = sample(rng, free, narrow, 0.35)
        node, _ = grow(one, side, clearance, radius, x, y, longest)
        if node < 0:
            continue
        met, is_there = grow(
            other, side, clearance, radius, one.xy[node, 0], one.xy[node, 1], np.inf
        )
        if is_there:
            return (FOUND, node, met) if turn % 2 == 0 else (FOUND, met, node)
    return GOING_ON, -1, -1


@compiled
def points_near(
    tree: Tree, side: float, x: float, y: float, reach: float, near: NDArray[np.int32]
) -> int:
    """Collect the points within a distance, as many as there is room for; return how many."""
    rows, columns = tree.heads.shape
    found = 0
    for r in range(max(int((y - reach) / side), 0), min(int((y + reach) / side), rows - 1) + 1):
        for c in range(
            max(int((x - reach) / side), 0), min(int((x + reach) / side), columns - 1) + 1
        ):
            node = tree.heads[r, c]
            while node >= 0 and found < len(near):
                if (tree.xy[node, 0] - x) ** 2 + (tree.xy[node, 1] - y) ** 2 <= reach * reach:
                    near[found] = node
                    found += 1
                node = tree.links[node]
    return found


def branch(tree: Tree, node: int) -> NDArray[np.float64]:
    """Return the points from the root to a point, (n, 2)."""
    nodes = [node]
    while tree.parent[nodes[-1]] >= 0:
        nodes.append(int(tree.parent[nodes[-1]]))
    return tree.xy[nodes[::-1]].copy()
