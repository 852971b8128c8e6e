"""Paths over trees of points: the shortest one over all points, and shorter ones between them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.planning.path.global_planning.heap import pop, push
from robotctl.planning.path.global_planning.trees.motions import free_share, price_of
from robotctl.planning.path.global_planning.trees.tree import Tree, poses_near


@compiled
def rejoin(
    tree: Tree,
    clearance: NDArray[np.float32],
    radius: float,
    goal: int,
    reach: float,
) -> NDArray[np.int32]:
    """Return the points of the shortest path from point 0 to another, in any order of growth.

    Points that see each other within `reach` are joined: Dijkstra's algorithm, which looks at a
    piece only when it would make a path shorter. Empty where there is no path.
    """
    count = tree.size[0]
    cost = np.full(count, np.inf)
    came = np.full(count, -1, np.int32)
    keys, items = np.empty(64 * count), np.empty(64 * count, np.int32)
    near = np.empty(256, np.int64)
    cost[0] = 0.0
    entries = push(keys, items, 0, 0.0, 0)
    while entries > 0:
        key = keys[0]
        node = pop(keys, items, entries)
        entries -= 1
        if node == goal:
            break
        if key > cost[node]:
            continue
        x, y = tree.pose[node, 0], tree.pose[node, 1]
        for k in range(poses_near(tree, tree.pose[node], reach, near)):
            other = near[k]
            ox, oy = tree.pose[other, 0], tree.pose[other, 1]
            new = key + np.hypot(ox - x, oy - y)
            if new >= cost[other] or free_share(clearance, radius, x, y, ox, oy) < 1.0:
                continue
            if entries == len(keys):
                return np.empty(0, np.int32)
            cost[other], came[other] = new, node
            entries = push(keys, items, entries, new, other)
    if cost[goal] == np.inf:
        return np.empty(0, np.int32)
    path = [goal]
    while path[-1] != 0:
        path.append(came[path[-1]])
    return np.array(path[::-1], np.int32)


@compiled
def price_along(path: NDArray[np.float64], prices: NDArray[np.float64]) -> float:
    """Return the cost of a path (n, 2); `prices` are those of `price_of`."""
    cost = 0.0
    for k in range(len(path) - 1):
        cost += price_of(prices, path[k, 0], path[k, 1], path[k + 1, 0], path[k + 1, 1])
    return cost


@compiled
def shorten(
    points: NDArray[np.float64],
    clearance: NDArray[np.float32],
    radius: float,
    prices: NDArray[np.float64],
    rng: np.random.Generator,
    tries: int,
) -> NDArray[np.float64]:
    """Return a path (n, 2) with random pieces of it replaced by straight ones, where they are free.

    None costs more than what it replaces; `prices` are those of `price_of`.

    Geraerts and Overmars, "Creating high-quality paths for motion planning", 2007.
    """
    path = points.copy()
    for _ in range(tries):
        count = len(path)
        if count < 3:
            break
        i, j = int(rng.random() * (count - 1)), int(rng.random() * (count - 1))
        i, j = min(i, j), max(i, j)
        s, t = rng.random(), rng.random()
        ax, ay = path[i] + s * (path[i + 1] - path[i])
        bx, by = path[j] + t * (path[j + 1] - path[j])
        if i == j:
            continue
        old = price_of(prices, ax, ay, path[i + 1, 0], path[i + 1, 1])
        old += price_along(path[i + 1 : j + 1], prices)
        old += price_of(prices, path[j, 0], path[j, 1], bx, by)
        if price_of(prices, ax, ay, bx, by) > old - 1e-6:
            continue
        if free_share(clearance, radius, ax, ay, bx, by) < 1.0:
            continue
        shorter = np.empty((i + 1 + 2 + count - j - 1, 2))
        shorter[: i + 1] = path[: i + 1]
        shorter[i + 1, 0], shorter[i + 1, 1] = ax, ay
        shorter[i + 2, 0], shorter[i + 2, 1] = bx, by
        shorter[i + 3 :] = path[j + 1 :]
        path = shorter
    return path
