"""RRT* over straight pieces: a tree of points whose paths become cheaper as it grows.

Sources as in `point_tree`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robotctl.compiled import compiled
from robotctl.planning.path.global_planning.trees.point_tree import (
    FULL,
    GOING_ON,
    Tree,
    free_share,
    grow,
    points_near,
    price_of,
    sample,
)


@compiled
def grow_optimal(
    tree: Tree,
    side: float,
    clearance: NDArray[np.float32],
    radius: float,
    ends: tuple[float, float, float, float],
    free: NDArray[np.int32],
    narrow: NDArray[np.int32],
    rng: np.random.Generator,
    longest: float,
    prices: NDArray[np.float64],
    best: float,
    seen: NDArray[np.int32],
    rest: NDArray[np.float64],
    rounds: int,
) -> tuple[int, float]:
    """RRT*: grow for some rounds, by the cheapest parent near by, and let neighbours change theirs.

    The cost over each point from which the goal is seen counts; of `seen`, the first entry is the
    number of those, and `rest` has what it costs from each to the goal. Once a path is known,
    samples that cannot lie on a cheaper one are left out. `prices` are those of `price_of`. Return
    the state, and the cost of the best path.
    """
    gx, gy = ends[2], ends[3]
    area = len(free)
    near = np.empty(256, np.int32)
    for _ in range(rounds):
        if tree.size[0] + 2 > len(tree.parent):
            return FULL, best
        x, y = sample(rng, free, narrow, 0.3)
        if np.hypot(x - ends[0], y - ends[1]) + np.hypot(x - gx, y - gy) >= best:
            continue
        node, _ = grow(tree, side, clearance, radius, x, y, longest)
        if node < 0:
            continue
        x, y = tree.xy[node, 0], tree.xy[node, 1]
        parent = tree.parent[node]
        px, py = tree.xy[parent, 0], tree.xy[parent, 1]
        tree.cost[node] = tree.cost[parent] + price_of(prices, px, py, x, y)
        count = tree.size[0]
        # Karaman and Frazzoli 2011, theorem 38, in the plane: 2 (1 + 1/2)^(1/2) (area / pi)^(1/2).
        reach = min(longest, 2.45 * np.sqrt(area / np.pi * np.log(count + 1.0) / (count + 1.0)))
        found = points_near(tree, side, x, y, reach, near)
        _take_parent(tree, clearance, radius, prices, node, near[:found])
        _rewire(tree, clearance, radius, prices, node, near[:found])
        is_new = tree.cost[node] + np.hypot(gx - x, gy - y) < best and seen[0] + 1 < len(seen)
        if is_new and free_share(clearance, radius, x, y, gx, gy) >= 1.0:
            seen[0] += 1
            seen[seen[0]] = node
            rest[seen[0]] = price_of(prices, x, y, gx, gy)
        for k in range(1, seen[0] + 1):
            best = min(best, tree.cost[seen[k]] + rest[k])
    return GOING_ON, best


@compiled
def _take_parent(
    tree: Tree,
    clearance: NDArray[np.float32],
    radius: float,
    prices: NDArray[np.float64],
    node: int,
    near: NDArray[np.int32],
) -> None:
    """Give a new point the parent with the shortest path from the root."""
    x, y = tree.xy[node, 0], tree.xy[node, 1]
    for other in near:
        if other == node:
            continue
        ox, oy = tree.xy[other, 0], tree.xy[other, 1]
        if tree.cost[other] + np.hypot(x - ox, y - oy) >= tree.cost[node] - 1e-9:
            continue
        cost = tree.cost[other] + price_of(prices, ox, oy, x, y)
        if cost < tree.cost[node] - 1e-9 and (free_share(clearance, radius, ox, oy, x, y) >= 1.0):
            tree.parent[node], tree.cost[node] = other, cost


@compiled
def _rewire(
    tree: Tree,
    clearance: NDArray[np.float32],
    radius: float,
    prices: NDArray[np.float64],
    node: int,
    near: NDArray[np.int32],
) -> None:
    """Make a new point the parent of neighbours that it brings closer to the root.

    Their descendants are updated as they are passed: costs are upper bounds until then.
    """
    x, y = tree.xy[node, 0], tree.xy[node, 1]
    for other in near:
        ox, oy = tree.xy[other, 0], tree.xy[other, 1]
        if other == node or tree.cost[node] + np.hypot(ox - x, oy - y) >= tree.cost[other] - 1e-9:
            continue
        cost = tree.cost[node] + price_of(prices, x, y, ox, oy)
        if cost < tree.cost[other] - 1e-9 and (free_share(clearance, radius, x, y, ox, oy) >= 1.0):
            tree.parent[other], tree.cost[other] = node, cost
