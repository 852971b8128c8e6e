"""Motions between two poses: the curve, what it costs, and how far it is free.

All lengths are in cells of the map. A robot that steers drives Reeds-Shepp curves, or Dubins curves
where it must not reverse; one that turns on the spot drives straight pieces, each a curve of one
piece with a radius of 1. A tree that grows from the goal has motions in reverse order: they lead
away from the goal, and are driven towards it, so its Dubins curves are those of a robot that only
reverses.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.planning.map.planning_map import body_hits
from robotctl.planning.path.global_planning.curves import PIECES, along, dubins, reeds_shepp
from robotctl.planning.path.global_planning.hybrid_search import GEAR_CHANGE, REVERSE
from robotctl.planning.path.global_planning.smoothing import line

FORWARD, BOTH, BACKWARD, STRAIGHT = 1, 0, -1, 2
"""Steering: Dubins, Reeds-Shepp, Dubins in reverse, and straight pieces."""
_CHECK: Final = 0.5
"""Distance between two poses at which the body is checked [cells]."""
_ROOM: Final = 0.93
"""Maximum distance from a point to its cell's centre, plus the error of the clearance [cells]."""
_LEAST_STEP: Final = 1.0
"""A shorter curve brings nothing [cells]."""
_LEAST_PIECE: Final = 0.25
"""A shorter straight piece brings nothing [cells]."""
_BACK_OFF: Final = 0.8
"""Share of the free part of a curve that is driven: none leads on from an obstacle."""


class Course(NamedTuple):
    """The space in which the robot drives, and how it steers."""

    steering: int
    radius: float
    """Radius of the smallest turning circle; 1 for straight pieces."""
    blocked: NDArray[np.bool_]
    clearance: NDArray[np.float32]
    circle: float
    """Radius of the circle that must pass; on straight pieces it is all that must."""
    samples: NDArray[np.float64]
    """Points of the body, which must pass on curves."""
    discs: NDArray[np.float64]
    """Circles that cover it, (n, 3)."""
    prices: NDArray[np.float64]
    """(rows, columns): what a unit of length costs, at least 1; (0, 0): 1 everywhere."""
    free: NDArray[np.int32]
    """(n, 2): rows and columns of the cells that the robot can reach."""
    narrow: NDArray[np.int32]
    """(n, 2): those of them in narrow passages."""

    @property
    def backward(self) -> Course:
        """Course of a tree that grows from the goal."""
        return self if self.steering == STRAIGHT else self._replace(steering=-self.steering)


@compiled
def curve_between(
    a: NDArray[np.float64], b: NDArray[np.float64], radius: float, steering: int
) -> NDArray[np.float64]:
    """Return the shortest curve between two poses, (2, 5): turns, and signed lengths [radii]."""
    if steering == STRAIGHT:
        piece = np.zeros((2, PIECES))
        piece[1, 0] = math.hypot(b[0] - a[0], b[1] - a[1])
        return piece
    c, s = math.cos(a[2]), math.sin(a[2])
    dx, dy = (b[0] - a[0]) / radius, (b[1] - a[1]) / radius
    x, y, theta = c * dx + s * dy, c * dy - s * dx, b[2] - a[2]
    if steering == BOTH:
        return reeds_shepp(x, y, theta)
    if steering == FORWARD:
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
def drive(
    course: Course,
    start: NDArray[np.float64],
    curve: NDArray[np.float64],
    end: NDArray[np.float64],
) -> tuple[bool, float]:
    """Return whether the motion to a pose is free, and what it costs; only then meaningful."""
    if course.steering == STRAIGHT:
        x0, y0, x1, y1 = start[0], start[1], end[0], end[1]
        is_free = free_share(course.clearance, course.circle, x0, y0, x1, y1) >= 1.0
        return is_free, price_of(course.prices, x0, y0, x1, y1) if is_free else 0.0
    way, cost = drive_along(course, start, curve, np.inf)
    return way == np.inf, cost


@compiled
def advance(
    course: Course,
    start: NDArray[np.float64],
    curve: NDArray[np.float64],
    end: NDArray[np.float64],
    longest: float,
) -> tuple[bool, NDArray[np.float64], NDArray[np.float64], float, bool]:
    """Go towards a pose as far as it is free, at most `longest`.

    Return whether that leads anywhere, the pose there, the motion to it, its cost, and whether it
    is the pose itself.
    """
    if course.steering == STRAIGHT:
        return _advance_straight(course, start, curve, end, longest)
    way, cost = drive_along(course, start, curve, longest)
    if way == np.inf:
        return True, end, curve, cost, True
    length = way if length_of(curve, course.radius) > longest <= way + 1.0 else _BACK_OFF * way
    if length < _LEAST_STEP:
        return False, end, curve, 0.0, False
    part = beginning(curve, length / course.radius)
    way, cost = drive_along(course, start, part, np.inf)
    # The body is checked at other poses than before.
    return way == np.inf, end_of(start, part, course.radius), part, cost, False


@compiled
def _advance_straight(
    course: Course,
    start: NDArray[np.float64],
    curve: NDArray[np.float64],
    end: NDArray[np.float64],
    longest: float,
) -> tuple[bool, NDArray[np.float64], NDArray[np.float64], float, bool]:
    """Do the same on a straight piece."""
    x0, y0 = start[0], start[1]
    length = curve[1, 0]
    share = min(1.0, longest / length)
    there, part = end.copy(), curve.copy()
    there[0], there[1] = x0 + share * (end[0] - x0), y0 + share * (end[1] - y0)
    free = free_share(course.clearance, course.circle, x0, y0, there[0], there[1])
    if free < 1.0:
        # Half a cell back from the wall, in a cell that is passable for sure.
        free -= 0.5 / (share * length)
        if free * share * length < _LEAST_PIECE:
            return False, end, curve, 0.0, False
        there[0] = x0 + free * share * (end[0] - x0)
        there[1] = y0 + free * share * (end[1] - y0)
    part[1, 0] = math.hypot(there[0] - x0, there[1] - y0)
    cost = price_of(course.prices, x0, y0, there[0], there[1])
    return True, there, part, cost, free >= 1.0 and share >= 1.0


@compiled
def drive_along(
    course: Course, start: NDArray[np.float64], curve: NDArray[np.float64], longest: float
) -> tuple[float, float]:
    """Return how far a curve can be driven, at most `longest`, and what all of it costs.

    The distance is inf if its end is reached; the cost is meaningful only then.
    """
    poses, gears = along(curve, course.radius, _CHECK)
    c, s = math.cos(start[2]), math.sin(start[2])
    is_priced = len(course.prices) > 0
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
        price = course.prices[int(y), int(x)] if is_priced else 1.0
        cost += step * price * (1.0 if gears[i] > 0 else REVERSE)
        cost += GEAR_CHANGE if gear == -gears[i] else 0.0
        gear = gears[i]
    return np.inf, cost


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
