"""Hybrid-state A*: paths that a steered robot can drive, forwards and in reverse.

Dolgov, Thrun, Montemerlo, Diebel, "Path planning for autonomous vehicles in unknown
semi-structured environments", 2010. A state is a pose; of all poses in one cell of place and
heading the cheapest is kept. From each the robot drives a short arc: straight, or with one of four
steering angles, in either gear. What is left to the goal is at least the shortest way through the
map for a circle inside of the body, and at least the Reeds-Shepp path, which takes longer to find
and is asked for only when a pose is about to be expanded. All lengths are in cells of the map.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import borrows, compiled
from robotctl.planning.map.planning_map import body_hits
from robotctl.planning.path.global_planning.curves import along, reeds_shepp
from robotctl.planning.path.global_planning.heap import pop, push

GOING_ON, FULL, ENDED, FOUND = 0, 1, 2, 3
HEADINGS: Final = 72
_SQRT2: Final = math.sqrt(2.0)
_DOWN: Final = np.array([0, 0, 1, -1, 1, 1, -1, -1])
_RIGHT: Final = np.array([1, -1, 0, 0, 1, -1, 1, -1])
_STEERINGS: Final = np.array([0.0, 1.0, -1.0, 0.5, -0.5])
"""As shares of the largest curvature."""
REVERSE: Final = 2.0
"""Cost of a unit of length in reverse, as a multiple of that forwards."""
GEAR_CHANGE: Final = 8.0
"""Cost of a change of gear [cells]."""
_STEERING_CHANGE: Final = 0.2
"""Cost of steering from straight to the limit [cells]."""
_GREED: Final = 1.1
"""Weight of the remaining cost (weighted A*): paths cost up to 10 % more than the best, and are
found in a fraction of the time."""
_ENOUGH: Final = 1.05
"""A path is good enough if no other can be cheaper by more than this factor: no bound includes the
turn to the heading at the goal, so searching for a cheaper path would take long."""
_CHECK: Final = 1.0
"""Maximum way of a corner of the body between two poses at which it is checked [cells]."""


class SearchSpace(NamedTuple):
    """A `PlanningMap` as compiled code takes it, and what follows from it for one goal."""

    blocked: NDArray[np.bool_]
    clearance: NDArray[np.float32]
    prices: NDArray[np.float32]
    """(rows, columns): what a unit of length costs."""
    samples: NDArray[np.float64]
    """Points of the body."""
    discs: NDArray[np.float64]
    """Circles that cover it, (n, 3)."""
    to_go: NDArray[np.float64]
    """(rows, columns) of coarse cells: least cost from there to the goal; inf: no way."""
    side: float
    """Side of a coarse cell."""
    radius: float
    """Radius of the smallest turning circle."""
    swing: float
    """How much farther the outermost corner goes than `base` on it, as a share of that way."""


class Nodes(NamedTuple):
    """Poses that were reached."""

    pose: NDArray[np.float64]
    """(n, 3)."""
    cost: NDArray[np.float64]
    parent: NDArray[np.int32]
    steering: NDArray[np.float32]
    """Curvature of the arc that led there, as a share of the maximum."""
    gear: NDArray[np.int8]
    """1, or -1 in reverse; 0 at the start."""
    best: NDArray[np.int32]
    """(coarse rows, columns, headings): the node + 1 that is cheapest there; 0: none."""
    closed: NDArray[np.bool_]
    bounded: NDArray[np.bool_]
    """Whether the Reeds-Shepp path was asked for already."""
    keys: NDArray[np.float64]
    """Binary heap of what nodes cost at least on to the goal."""
    heap: NDArray[np.int32]
    counts: NDArray[np.int64]
    """Nodes, entries of the heap, nodes expanded, and the node before the last curve + 1."""
    curve: NDArray[np.float64]
    """(2, 5), the Reeds-Shepp path from there to the goal."""
    found: NDArray[np.float64]
    """(1,): the cost over that curve; inf: none yet."""


NODE, ENTRY, EXPANDED, LAST = range(4)


def make_nodes(shape: tuple[int, int], capacity: int) -> Nodes:
    """Return room for so many nodes on a map of (rows, columns) coarse cells."""
    return Nodes(
        np.empty((capacity, 3)),
        np.empty(capacity),
        np.empty(capacity, np.int32),
        np.empty(capacity, np.float32),
        np.empty(capacity, np.int8),
        np.zeros((*shape, HEADINGS), np.int32),  # a page of zeros costs nothing until touched
        np.zeros(capacity, np.bool_),
        np.zeros(capacity, np.bool_),
        np.empty(capacity),
        np.empty(capacity, np.int32),
        np.zeros(4, np.int64),
        np.zeros((2, 5)),
        np.full(1, math.inf),
    )


@compiled
def price_cells(
    clearance: NDArray[np.float32],
    zone_prices: NDArray[np.float32],
    least: float,
    near: float,
    comfort: float,
    weight: float,
    factor: int,
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Return the cost of a unit of length in each cell, and the cost of crossing each coarse cell.

    Parameters
    ----------
    clearance
        (rows, columns).
    zone_prices
        (rows, columns): how many times longer a path counts there, for slow zones.
    least
        With less, no robot of any heading fits.
    near, comfort, weight
        A price falls from 1 + weight, at a clearance of `near` and below, to 1 in `comfort` more.
    factor
        Cells on the side of a coarse one, whose price is the mean of those that are passable.
    """
    rows, columns = clearance.shape
    prices = np.empty((rows, columns), np.float32)
    coarse = np.full((-(-rows // factor), -(-columns // factor)), np.inf)
    slope = weight / comfort if comfort > 0.0 else 0.0
    for r in range(coarse.shape[0]):
        for c in range(coarse.shape[1]):
            total, count = 0.0, 0
            for row in range(r * factor, min((r + 1) * factor, rows)):
                for column in range(c * factor, min((c + 1) * factor, columns)):
                    room = clearance[row, column]
                    if room < least:
                        prices[row, column] = np.inf
                        continue
                    price = 1.0 + slope * min(max(near + comfort - room, 0.0), comfort)
                    price *= zone_prices[row, column]
                    prices[row, column] = price
                    total += price
                    count += 1
            if count > 0:
                coarse[r, c] = factor * total / count
    return prices, coarse


@compiled
def cost_to_go(coarse: NDArray[np.float64], goal_row: int, goal_column: int) -> NDArray[np.float64]:
    """Return the least cost from each coarse cell to the goal's: Dijkstra's algorithm.

    Parameters
    ----------
    coarse
        (rows, columns): what it costs to cross each cell from side to side; inf: blocked.
    """
    rows, columns = coarse.shape
    cost = np.full((rows, columns), np.inf)
    keys, items = np.empty(8 * rows * columns + 8), np.empty(8 * rows * columns + 8, np.int32)
    cost[goal_row, goal_column] = 0.0
    count = push(keys, items, 0, 0.0, goal_row * columns + goal_column)
    while count > 0:
        key = keys[0]
        cell = pop(keys, items, count)
        count -= 1
        row, column = cell // columns, cell % columns
        if key > cost[row, column]:
            continue
        for k in range(8):
            r, c = row + _DOWN[k], column + _RIGHT[k]
            if not (0 <= r < rows and 0 <= c < columns):
                continue
            new = key + coarse[r, c] * (1.0 if k < 4 else _SQRT2)
            if new < cost[r, c]:
                cost[r, c] = new
                count = push(keys, items, count, new, r * columns + c)
    return cost


@compiled
@borrows
def _reach(
    world: SearchSpace,
    nodes: Nodes,
    parent: int,
    x: float,
    y: float,
    theta: float,
    cost: float,
    steering: float,
    gear: int,
) -> None:
    """Keep a pose, if it is the cheapest in its cell and the goal can be reached from there."""
    rows, columns = world.to_go.shape
    row, column = int(y / world.side), int(x / world.side)
    if not (0 <= row < rows and 0 <= column < columns) or world.to_go[row, column] == np.inf:
        return
    heading = int((theta % (2.0 * math.pi)) / (2.0 * math.pi) * HEADINGS) % HEADINGS
    before = nodes.best[row, column, heading] - 1
    if before >= 0 and nodes.cost[before] <= cost:
        return
    node = nodes.counts[NODE]
    nodes.counts[NODE] = node + 1
    nodes.pose[node, 0], nodes.pose[node, 1], nodes.pose[node, 2] = x, y, theta
    nodes.cost[node], nodes.parent[node] = cost, parent
    nodes.steering[node], nodes.gear[node] = steering, gear
    nodes.best[row, column, heading] = node + 1
    if before >= 0:
        nodes.closed[before] = True
    key = cost + _GREED * world.to_go[row, column]
    nodes.counts[ENTRY] = push(nodes.keys, nodes.heap, nodes.counts[ENTRY], key, node)


@compiled
def drive(
    x: float, y: float, theta: float, curvature: float, s: float
) -> tuple[float, float, float]:
    """Return the pose after an arc of length s, signed, of a curvature."""
    turn = curvature * s
    if abs(turn) < 1e-9:
        return x + s * math.cos(theta), y + s * math.sin(theta), theta
    r = 1.0 / curvature
    end = theta + turn
    return x + r * (math.sin(end) - math.sin(theta)), y - r * (math.cos(end) - math.cos(theta)), end


@compiled
def _curve(
    world: SearchSpace, nodes: Nodes, node: int, goal: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the Reeds-Shepp path from a node to the goal."""
    x, y, theta = nodes.pose[node]
    c, s = math.cos(theta), math.sin(theta)
    dx, dy, radius = goal[0] - x, goal[1] - y, world.radius
    return reeds_shepp((c * dx + s * dy) / radius, (c * dy - s * dx) / radius, goal[2] - theta)


@compiled
def _try_curve(world: SearchSpace, nodes: Nodes, node: int, path: NDArray[np.float64]) -> None:
    """Keep the curve from a node to the goal, if it is free and the cheapest so far."""
    x, y, theta = nodes.pose[node]
    c, s = math.cos(theta), math.sin(theta)
    radius = world.radius
    cost, gear = nodes.cost[node], nodes.gear[node]
    for k in range(5):
        length = path[1, k]
        if length == 0.0:
            continue
        now = 1 if length > 0.0 else -1
        cost += abs(length) * radius * (1.0 if now > 0 else REVERSE)
        cost += GEAR_CHANGE if gear not in (0, now) else 0.0
        gear = now
    if cost >= nodes.found[0]:
        return
    poses, gears = along(path, radius, _CHECK / (1.0 + world.swing))
    extra = 0.0
    for i in range(1, len(poses)):
        px = x + c * poses[i, 0] - s * poses[i, 1]
        py = y + s * poses[i, 0] + c * poses[i, 1]
        if body_hits(
            world.blocked, world.clearance, world.samples, world.discs,
            px, py, theta + poses[i, 2],
        ):  # fmt: skip
            return
        step = math.hypot(poses[i, 0] - poses[i - 1, 0], poses[i, 1] - poses[i - 1, 1])
        extra += step * (world.prices[int(py), int(px)] - 1.0) * (1.0 if gears[i] > 0 else REVERSE)
    if cost + extra < nodes.found[0]:
        nodes.found[0] = cost + extra
        nodes.counts[LAST] = node + 1
        nodes.curve[:] = path


@compiled
@borrows
def begin(world: SearchSpace, nodes: Nodes, start: NDArray[np.float64]) -> None:
    """Put the start among the nodes."""
    _reach(world, nodes, -1, start[0], start[1], start[2], 0.0, 0.0, 0)


@compiled
def expand(
    world: SearchSpace, nodes: Nodes, goal: NDArray[np.float64], step: float, piece: int
) -> int:
    """Expand up to `piece` nodes; return whether the search goes on, is full, or has ended.

    It has when no node can lead to a path that is much cheaper than the best that was found.
    """
    capacity = len(nodes.cost)
    for _ in range(piece):
        if nodes.counts[ENTRY] == 0:
            return FOUND if nodes.found[0] < np.inf else ENDED
        if nodes.counts[NODE] + 2 * len(_STEERINGS) + 1 >= capacity:
            return FOUND if nodes.found[0] < np.inf else FULL
        if _ENOUGH * nodes.keys[0] >= nodes.found[0]:
            return FOUND
        node = pop(nodes.keys, nodes.heap, nodes.counts[ENTRY])
        nodes.counts[ENTRY] -= 1
        if nodes.closed[node]:
            continue
        x, y = nodes.pose[node, 0], nodes.pose[node, 1]
        to_go = world.to_go[int(y / world.side), int(x / world.side)]
        expanded = nodes.counts[EXPANDED]
        # The nearer the goal, the more often a curve to it is worth the try.
        if not nodes.bounded[node] and expanded % (1 + int(to_go / (8.0 * world.radius))) == 0:
            nodes.bounded[node] = True
            path = _curve(world, nodes, node, goal)
            _try_curve(world, nodes, node, path)
            key = nodes.cost[node] + np.abs(path[1]).sum() * world.radius
            if key > nodes.cost[node] + _GREED * to_go:  # its turn comes later
                count = nodes.counts[ENTRY]
                nodes.counts[ENTRY] = push(nodes.keys, nodes.heap, count, key, node)
                continue
        nodes.closed[node] = True
        nodes.counts[EXPANDED] = expanded + 1
        _expand_node(world, nodes, node, step)
    return GOING_ON


@compiled
@borrows
def _expand_node(world: SearchSpace, nodes: Nodes, node: int, step: float) -> None:
    """Drive all arcs from a node."""
    x, y, theta = nodes.pose[node]
    before, gear_before = nodes.steering[node], nodes.gear[node]
    for gear in (1, -1):
        for steering in _STEERINGS:
            curvature = steering / world.radius
            checks = math.ceil(step * (1.0 + abs(steering) * world.swing) / _CHECK)
            is_free = True
            price = 0.0
            ex, ey, eth = x, y, theta
            for i in range(1, checks + 1):
                ex, ey, eth = drive(x, y, theta, curvature, gear * step * i / checks)
                if body_hits(
                    world.blocked, world.clearance, world.samples, world.discs, ex, ey, eth
                ):
                    is_free = False
                    break
                price += world.prices[int(ey), int(ex)]
            if not is_free:
                continue
            cost = nodes.cost[node] + step * price / checks * (1.0 if gear > 0 else REVERSE)
            cost += _STEERING_CHANGE * abs(steering - before)
            if gear_before not in (0, gear):
                cost += GEAR_CHANGE
            _reach(world, nodes, node, ex, ey, eth, cost, steering, gear)
