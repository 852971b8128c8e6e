"""How far a body can go on an arc until it touches a point."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.model.rectangle import Rectangle
from robotctl.planning.guard.course import LEAST_CLOSING, Course, Point

_STRAIGHT: Final = 1e-4
"""An arc of a smaller curvature is a straight line [1/m]: half a millimetre in three metres."""
_WALL: Final = 3
"""Points that make a wall."""
_RAGGED_M: Final = 0.02
"""Points of a wall are so far aside of it [m]."""
_DEEPEST_M: Final = 0.05
"""Points deeper below a side of the body than it is drawn too wide make no wall beside it [m]."""
_ROUNDING_M: Final = 1e-6
"""A point this near to a side lies on it [m]: it may leave there."""
_STANDS: Final = 1e-9
"""Motion per way of `base` below which a part of the body stands."""


def free_way(
    body: Rectangle,
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


@compiled
def _first_touched(
    body: Rectangle, points: NDArray[np.float64], margin_m: float, course: Course
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
def is_no_wall_beside(body: Rectangle, points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which points are none ahead or behind of a wall that reaches in at a side, (n,).

    The body is drawn with a little room, and a robot that stands so close beside a wall could not
    drive along it: what is as far aside as the wall beside the robot is passed as that is.
    """
    kept = np.ones(len(points), np.bool_)
    depths = np.empty(len(points))
    for side in (1.0, -1.0):
        count = 0
        for number in range(len(points)):
            x, y = points[number, 0], points[number, 1]
            depth = body.half_width_m - side * y
            if 0.0 <= depth <= min(body.front_m - x, x - body.rear_m, _DEEPEST_M):
                depths[count] = depth
                count += 1
        if count < _WALL:
            continue
        beside = np.sort(depths[:count])
        wall_m = 0.5 * (beside[(count - 1) // 2] + beside[count // 2]) + _RAGGED_M
        for number in range(len(points)):
            x, y = points[number, 0], points[number, 1]
            depth = body.half_width_m - side * y
            from_ends = min(body.front_m - x, x - body.rear_m, _DEEPEST_M)
            kept[number] &= depth > wall_m or 0.0 <= depth <= from_ends
    return kept


@compiled
def way_to_contact(body: Rectangle, x: float, y: float, course: Course) -> float:
    """Return how far `base` moves until the body touches a point [m]; inf: never.

    A point within the body is touched at once if it gets deeper below the side that is nearest to
    it, and not at all if it leaves there.

    Parameters
    ----------
    x, y
        The point in `base` [m].
    course
        Where `base` goes; on the spot ways are angles [rad].
    """
    depths = (body.front_m - x, x - body.rear_m, body.half_width_m - y, body.half_width_m + y)
    least = min(depths)
    if least < -_ROUNDING_M:
        if abs(course.turn) < _STRAIGHT:
            return _straight(body, x, y, course)
        return _on_arc(body, x, y, course)
    # Motion of the point in the body, towards the nearest of the sides.
    ahead, left = _motion(course, x, y)
    if least == depths[0]:
        outwards = -ahead
    elif least == depths[1]:
        outwards = ahead
    else:
        outwards = -left if least == depths[2] else left
    return 0.0 if outwards < -LEAST_CLOSING else math.inf


@compiled
def _motion(course: Course, x: float, y: float) -> tuple[float, float]:
    """Return the motion of the body at a point, forwards and to the left."""
    return course.ahead - course.turn * y, course.left + course.turn * x


@compiled
def _straight(body: Rectangle, x: float, y: float, course: Course) -> float:
    """Return the way straight on until the body holds a point outside of it.

    It does where both of its coordinates lie between two sides.
    """
    half = body.half_width_m
    enters, leaves = -math.inf, math.inf
    for at, low, high, share in (
        (x, body.rear_m, body.front_m, course.ahead),
        (y, -half, half, course.left),
    ):
        if abs(share) < _STANDS:
            if at < low or at > high:
                return math.inf
            continue
        near, far = (high, low) if share > 0.0 else (low, high)
        enters = max(enters, (at - near) / share)
        leaves = min(leaves, (at - far) / share)
    return enters if 0.0 <= enters <= leaves else math.inf


@compiled
def _on_arc(body: Rectangle, x: float, y: float, course: Course) -> float:
    """Return the way on an arc until the body touches a point outside of it.

    Seen from the body, a point goes round the centre of the arc the other way, and meets the body
    where its circle first crosses one of the sides.
    """
    centre_x, centre_y = -course.left / course.turn, course.ahead / course.turn
    x, y = x - centre_x, y - centre_y
    square = x * x + y * y
    rear, front = body.rear_m - centre_x, body.front_m - centre_x
    right, left = -body.half_width_m - centre_y, body.half_width_m - centre_y
    sense, least = math.copysign(1.0, course.turn), math.inf
    for end in (rear, front):
        if end * end <= square:
            across = math.sqrt(square - end * end)
            for at in (across, -across):
                if right <= at <= left:
                    least = min(least, _turned(x, y, end, at, sense))
    for side in (right, left):
        if side * side <= square:
            along = math.sqrt(square - side * side)
            for at in (along, -along):
                if rear <= at <= front:
                    least = min(least, _turned(x, y, at, side, sense))
    return least / abs(course.turn)


@compiled
def _turned(x: float, y: float, to_x: float, to_y: float, sense: float) -> float:
    """Return the angle from one point of a circle back to another, in a sense [rad]."""
    return ((math.atan2(y, x) - math.atan2(to_y, to_x)) * sense) % math.tau
