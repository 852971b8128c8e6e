"""How far a body can go on an arc until it touches a point."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import borrows, compiled
from robotctl.model.footprint_arrays import HULL, OPEN, PIECE, Sides
from robotctl.planning.guard.course import LEAST_CLOSING, Course, Point

_STRAIGHT: Final = 1e-4
"""An arc of a smaller curvature is a straight line [1/m]: half a millimetre in three metres."""
_WALL: Final = 3
"""Points that make a wall."""
_RAGGED_M: Final = 0.02
"""Points of a wall are so far aside of it [m]."""
_DEEPEST_M: Final = 0.05
"""Points deeper below a side of the body than it is drawn too wide make no wall beside it [m]."""
_LENGTHWISE: Final = 0.1
"""A side of the body along which it drives has a normal with less than this ahead, or behind."""
_ROUNDING_M: Final = 1e-6
"""A point this near to a side lies on it [m]: it may leave there."""
_ROUNDED_M: Final = 1e-9
"""Distance by which a point between two pieces may seem to lie outside of both [m]."""
_STANDS: Final = 1e-9
"""Motion per way of `base` below which a part of the body stands."""


def free_way(
    body: Sides,
    points: NDArray[np.float64],
    margin_m: float,
    course: Course,
) -> tuple[float, Point | None]:
    """Return the way of `base` until the body is a margin away from a point in its way, and which.

    The margin is a way of the part of the body that would touch the point. The parameters and the
    unit are those of `way_to_contact`; inf and None if there is no such point.
    """
    if not len(points):
        return math.inf, None
    free, nearest = _first_touched(body, np.ascontiguousarray(points), margin_m, course)
    if nearest < 0:
        return math.inf, None
    x_m, y_m = points[nearest].tolist()
    return free, (x_m, y_m)


def is_in_cone(
    points: NDArray[np.float64],
    place: Point,
    axis: Point,
    range_m: float,
    off_m: float,
    half_rad: float,
) -> bool:
    """Return whether one of some points (n, 2) is where a sonar may have an echo from.

    Parameters
    ----------
    place, axis
        Of the sonar: its place [m] and where it looks, a unit vector.
    range_m, off_m
        Its range, and by how much that may differ from the point's distance [m].
    half_rad
        Half the opening of its cone [rad].
    """
    away = points - place
    lengths = np.hypot(away[:, 0], away[:, 1])
    inside = away @ np.array(axis) >= math.cos(half_rad) * lengths
    return bool((inside & (np.abs(lengths - range_m) <= off_m)).any())


@compiled
def _first_touched(
    body: Sides, points: NDArray[np.float64], margin_m: float, course: Course
) -> tuple[float, int]:
    """Return the way until the margin of the first point, and its number; -1: there is none."""
    kept = is_no_wall_beside(body, points)
    free, nearest = math.inf, -1
    for number in range(len(points)):
        if not kept[number]:
            continue
        x, y = points[number, 0], points[number, 1]
        way = way_to_contact(body, x, y, course)
        if way < math.inf:
            ahead, left = _motion(course, x, y)
            way -= margin_m / max(math.hypot(ahead, left), _STANDS)
            if way < free:
                free, nearest = way, number
    return free, nearest


@compiled
def is_no_wall_beside(body: Sides, points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which points are none ahead or behind of a wall that reaches in at a side, (n,).

    The body is drawn with a little room, and a robot that stands so close beside a wall could not
    drive along it: what is as far aside as the wall beside the robot is passed as that is. Only
    sides count beyond which there is nothing of the body, or an arm would be driven into that.
    """
    kept = np.ones(len(points), np.bool_)
    depths = np.empty(len(points))
    for side in range(len(body)):
        if abs(body[side, 0]) >= _LENGTHWISE or body[side, HULL] == 0.0:
            continue
        count = 0
        for number in range(len(points)):
            depth, others = _depths(body, side, points[number, 0], points[number, 1])
            if 0.0 <= depth <= min(others, _DEEPEST_M):
                depths[count] = depth
                count += 1
        if count < _WALL:
            continue
        beside = np.sort(depths[:count])
        wall_m = 0.5 * (beside[(count - 1) // 2] + beside[count // 2]) + _RAGGED_M
        for number in range(len(points)):
            depth, others = _depths(body, side, points[number, 0], points[number, 1])
            kept[number] &= depth > wall_m or 0.0 <= depth <= min(others, _DEEPEST_M)
    return kept


@compiled
@borrows
def _depths(body: Sides, side: int, x: float, y: float) -> tuple[float, float]:
    """Return how deep a point lies below a side, and below the nearest other of its piece [m]."""
    others = np.inf
    for k in range(len(body)):
        if k != side and body[k, PIECE] == body[side, PIECE]:
            others = min(others, body[k, 2] - body[k, 0] * x - body[k, 1] * y)
    return body[side, 2] - body[side, 0] * x - body[side, 1] * y, others


@compiled
@borrows
def depth_below(sides: Sides, x: float, y: float) -> float:
    """Return how deep a point lies below the nearest side [m]; < 0: outside.

    Of several pieces, the one in which it lies deepest counts outside of them, and inside the sides
    beyond which there is nothing of the body: to those between two pieces nothing is near.
    """
    most, least, piece = -np.inf, np.inf, 0.0
    for k in range(len(sides)):
        if sides[k, PIECE] != piece:
            most, least, piece = max(most, least), np.inf, sides[k, PIECE]
            if piece == OPEN:
                return most if most < -_ROUNDED_M else _from_open_side(sides, x, y)[0]
        least = min(least, sides[k, 2] - sides[k, 0] * x - sides[k, 1] * y)
    return max(most, least)


@compiled
@borrows
def _from_open_side(sides: Sides, x: float, y: float) -> tuple[float, float, float]:
    """Return how far a point in the body is from the nearest open side [m], and which way inwards.

    Away from a corner that reaches into the body, or straight away from a side.
    """
    least, to_x, to_y = np.inf, 0.0, 0.0
    for k in range(len(sides) - 1, -1, -1):
        if sides[k, PIECE] != OPEN:
            break
        nx, ny = sides[k, 0], sides[k, 1]
        along = nx * y - ny * x
        at = min(max(along, sides[k, 3]), sides[k, 4])
        off_x, off_y = x - (nx * sides[k, 2] - ny * at), y - (ny * sides[k, 2] + nx * at)
        away = math.hypot(off_x, off_y)
        if away < least:
            least, to_x, to_y = away, -nx, -ny
            if at != along and away > 2.0 * _ROUNDING_M:
                to_x, to_y = off_x / away, off_y / away
    return least, to_x, to_y


@compiled
def way_to_contact(body: Sides, x: float, y: float, course: Course) -> float:
    """Return how far `base` moves until the body touches a point [m]; inf: never.

    A point within the body is touched at once if it gets deeper below the side that is nearest to
    it, and not at all if it leaves there; or by another piece that follows.

    Parameters
    ----------
    x, y
        The point in `base` [m].
    course
        Where `base` goes; on the spot ways are angles [rad].
    """
    least = depth_below(body, x, y)
    if least < -_ROUNDING_M:
        if abs(course.turn) < _STRAIGHT:
            return _straight(body, x, y, course)
        return _on_arc(body, x, y, course, False)
    # Motion of the point in the body, towards the nearest of the sides.
    ahead, left = _motion(course, x, y)
    if body[len(body) - 1, PIECE] == OPEN:
        _, to_x, to_y = _from_open_side(body, x, y)
        if -ahead * to_x - left * to_y > LEAST_CLOSING:
            return 0.0
        return _followed(body, x, y, course)
    for k in range(len(body)):
        if body[k, 2] - body[k, 0] * x - body[k, 1] * y == least:
            outwards = -ahead * body[k, 0] - left * body[k, 1]
            return 0.0 if outwards < -LEAST_CLOSING else math.inf
    return math.inf


@compiled
def _motion(course: Course, x: float, y: float) -> tuple[float, float]:
    """Return the motion of the body at a point, forwards and to the left."""
    return course.ahead - course.turn * y, course.left + course.turn * x


@compiled
@borrows
def _straight(body: Sides, x: float, y: float, course: Course) -> float:
    """Return the way straight on until the body holds a point outside of it.

    It does where the point has crossed all sides inwards and none outwards (Cyrus and Beck
    clip a line so, Computers and Graphics 3, 1978).
    """
    enters, leaves, piece, least = -math.inf, math.inf, 0.0, math.inf
    for k in range(len(body)):
        if body[k, PIECE] != piece:
            least = min(least, enters if 0.0 <= enters <= leaves else math.inf)
            enters, leaves, piece = -math.inf, math.inf, body[k, PIECE]
            if piece == OPEN:
                return least
        outside = body[k, 0] * x + body[k, 1] * y - body[k, 2]
        closing = body[k, 0] * course.ahead + body[k, 1] * course.left
        if abs(closing) < _STANDS:
            if outside > 0.0:
                leaves = -math.inf
        elif closing > 0.0:
            enters = max(enters, outside / closing)
        else:
            leaves = min(leaves, outside / closing)
    return min(least, enters if 0.0 <= enters <= leaves else math.inf)


@compiled
@borrows
def _on_arc(body: Sides, x: float, y: float, course: Course, inwards: bool) -> float:
    """Return the way on an arc until the body touches a point outside of it.

    Seen from the body, a point goes round the centre of the arc the other way, and meets the body
    where its circle first crosses one of the sides; with `inwards`, only from without.
    """
    centre_x, centre_y = -course.left / course.turn, course.ahead / course.turn
    x, y = x - centre_x, y - centre_y
    square = x * x + y * y
    sense, least = math.copysign(1.0, course.turn), math.inf
    for k in range(len(body)):
        nx, ny = body[k, 0], body[k, 1]
        # The side from the centre: its line at that distance, along the normal turned to the left.
        away = body[k, 2] - nx * centre_x - ny * centre_y
        along = nx * centre_y - ny * centre_x
        if away * away <= square:
            half = math.sqrt(square - away * away)
            for at in (half, -half):
                if body[k, 3] - along <= at <= body[k, 4] - along:
                    to_x, to_y = nx * away - ny * at, ny * away + nx * at
                    if inwards and sense * at >= 0.0:
                        continue
                    least = min(least, _turned(x, y, to_x, to_y, sense))
    return least / abs(course.turn)


@compiled
@borrows
def _followed(body: Sides, x: float, y: float, course: Course) -> float:
    """Return the way until an open side of the body comes over a point that was not under it."""
    least, straight = math.inf, abs(course.turn) < _STRAIGHT
    for k in range(len(body) - 1, -1, -1):
        if body[k, PIECE] != OPEN:
            break
        if straight:
            closing = body[k, 0] * course.ahead + body[k, 1] * course.left
            outside = body[k, 0] * x + body[k, 1] * y - body[k, 2]
            if closing > _STANDS and outside > _ROUNDING_M:
                way = outside / closing
                to_x, to_y = x - way * course.ahead, y - way * course.left
                if body[k, 3] <= body[k, 0] * to_y - body[k, 1] * to_x <= body[k, 4]:
                    least = min(least, way)
        else:
            least = min(least, _on_arc(body[k : k + 1], x, y, course, True))
    return least


@compiled
def _turned(x: float, y: float, to_x: float, to_y: float, sense: float) -> float:
    """Return the angle from one point of a circle back to another, in a sense [rad]."""
    return ((math.atan2(y, x) - math.atan2(to_y, to_x)) * sense) % math.tau
