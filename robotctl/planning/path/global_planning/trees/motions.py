"""Motions of a steered robot between two poses: the curve, what it costs, and how far it is free.

All lengths are in cells of the map. A robot drives Reeds-Shepp curves, or Dubins curves where it
must not reverse. A tree that grows from the goal has motions in reverse order: they lead away from
the goal, and are driven towards it, so its Dubins curves are those of a robot that only reverses.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robotctl.compiled import compiled
from robotctl.planning.map.planning_map import body_hits
from robotctl.planning.path.global_planning.curves import PIECES, along, dubins, reeds_shepp
from robotctl.planning.path.global_planning.hybrid_search import GEAR_CHANGE, REVERSE

FORWARD, BOTH, BACKWARD = 1, 0, -1
"""Gears of a curve: Dubins, Reeds-Shepp, and Dubins in reverse."""
_CHECK: Final = 0.5
"""Distance between two poses at which the body is checked [cells]."""


class Course(NamedTuple):
    """The space in which the robot drives."""

    blocked: NDArray[np.bool_]
    clearance: NDArray[np.float32]
    prices: NDArray[np.float32]
    """(rows, columns): what a unit of length costs, at least 1."""
    samples: NDArray[np.float64]
    """Points of the body."""
    discs: NDArray[np.float64]
    """Circles that cover it, (n, 3)."""
    radius: float
    """Radius of the smallest turning circle."""


@compiled
def curve_between(
    a: NDArray[np.float64], b: NDArray[np.float64], radius: float, gears: int
) -> NDArray[np.float64]:
    """Return the shortest curve between two poses, (2, 5): turns, and signed lengths [radii]."""
    c, s = math.cos(a[2]), math.sin(a[2])
    dx, dy = (b[0] - a[0]) / radius, (b[1] - a[1]) / radius
    x, y, theta = c * dx + s * dy, c * dy - s * dx, b[2] - a[2]
    if gears == BOTH:
        return reeds_shepp(x, y, theta)
    if gears == FORWARD:
        return dubins(x, y, theta)
    path = dubins(-x, y, -theta)  # as a mirror behind the robot shows it
    path[1] *= -1.0
    return path


@compiled
def length_of(curve: NDArray[np.float64], radius: float) -> float:
    """Return the length of a curve."""
    total = 0.0
    for k in range(PIECES):
        total += abs(curve[1, k])
    return total * radius


@compiled
def first_gear(curve: NDArray[np.float64]) -> int:
    """Return the gear of the first piece: 1, -1 in reverse, 0 if there is no piece."""
    for k in range(PIECES):
        if curve[1, k] != 0.0:
            return 1 if curve[1, k] > 0.0 else -1
    return 0


@compiled
def last_gear(curve: NDArray[np.float64]) -> int:
    """Return the gear of the last piece, as `first_gear` does."""
    for k in range(PIECES - 1, -1, -1):
        if curve[1, k] != 0.0:
            return 1 if curve[1, k] > 0.0 else -1
    return 0


@compiled
def least_cost(curve: NDArray[np.float64], radius: float) -> float:
    """Return the cost of a curve where each unit of length costs 1."""
    cost, gear = 0.0, 0
    for k in range(PIECES):
        length = curve[1, k]
        if length == 0.0:
            continue
        now = 1 if length > 0.0 else -1
        cost += abs(length) * radius * (1.0 if now > 0 else REVERSE)
        cost += GEAR_CHANGE if gear == -now else 0.0
        gear = now
    return cost


@compiled
def drive_along(
    course: Course, start: NDArray[np.float64], curve: NDArray[np.float64], longest: float
) -> tuple[float, float]:
    """Return how far a curve can be driven, at most `longest`, and what all of it costs.

    The distance is inf if its end is reached; the cost is meaningful only then.
    """
    poses, gears = along(curve, course.radius, _CHECK)
    c, s = math.cos(start[2]), math.sin(start[2])
    way, cost, gear = 0.0, 0.0, 0
    for i in range(1, len(poses)):
        x = start[0] + c * poses[i, 0] - s * poses[i, 1]
        y = start[1] + s * poses[i, 0] + c * poses[i, 1]
        if body_hits(
            course.blocked, course.clearance, course.samples, course.discs,
            x, y, start[2] + poses[i, 2],
        ):  # fmt: skip
            return way, cost
        step = math.hypot(poses[i, 0] - poses[i - 1, 0], poses[i, 1] - poses[i - 1, 1])
        if way + step > longest:
            return way, cost
        way += step
        cost += step * course.prices[int(y), int(x)] * (1.0 if gears[i] > 0 else REVERSE)
        cost += GEAR_CHANGE if gear == -gears[i] else 0.0
        gear = gears[i]
    return math.inf, cost


@compiled
def beginning(curve: NDArray[np.float64], length: float) -> NDArray[np.float64]:
    """Return the part of a curve up to a length [radii]."""
    part = np.zeros((2, PIECES))
    for k in range(PIECES):
        part[0, k] = curve[0, k]
        part[1, k] = math.copysign(min(abs(curve[1, k]), length), curve[1, k])
        length = max(length - abs(curve[1, k]), 0.0)
    return part


@compiled
def end_of(
    start: NDArray[np.float64], curve: NDArray[np.float64], radius: float
) -> NDArray[np.float64]:
    """Return the pose at the end of a curve."""
    poses, _ = along(curve, radius, math.inf)
    c, s = math.cos(start[2]), math.sin(start[2])
    x, y, theta = poses[len(poses) - 1]
    return np.array([start[0] + c * x - s * y, start[1] + s * x + c * y, start[2] + theta])
