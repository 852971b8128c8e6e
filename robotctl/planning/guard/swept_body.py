"""How far a body can go on an arc until it touches a point."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

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
    unit are those of `ways_to_contact`; inf and None if there is no such point.
    """
    if not len(points):
        return math.inf, None
    points = without_walls_beside(body, points)
    ways = ways_to_contact(body, points, course)
    touched = np.isfinite(ways)
    if not np.count_nonzero(touched):  # a fifth of the time of any()
        return math.inf, None
    points, ways = points[touched], ways[touched]
    ahead, left = _motions(course, points)
    speeds = np.hypot(ahead, left)
    free = ways - margin_m / np.maximum(speeds, _STANDS)
    nearest = int(np.argmin(free))
    x_m, y_m = points[nearest].tolist()
    return float(free[nearest]), (x_m, y_m)


def without_walls_beside(body: Rectangle, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points without those ahead and behind of a wall that reaches in at a side.

    The body is drawn with a little room, and a robot that stands so close beside a wall could not
    drive along it: what is as far aside as the wall beside the robot is passed as that is.
    """
    x, y = points.T
    from_ends = np.minimum(body.front_m - x, x - body.rear_m)
    if np.count_nonzero(from_ends >= 0.0) < _WALL:
        return points
    kept = np.ones(len(points), np.bool_)
    for side in (1.0, -1.0):
        depths = body.half_width_m - side * y
        beside = (depths >= 0.0) & (depths <= np.minimum(from_ends, _DEEPEST_M))
        if np.count_nonzero(beside) >= _WALL:
            wall_m = float(np.median(depths[beside])) + _RAGGED_M
            kept &= beside | (depths > wall_m)
    return points[kept]


def ways_to_contact(
    body: Rectangle, points: NDArray[np.float64], course: Course
) -> NDArray[np.float64]:
    """Return how far `base` moves until the body touches each point, (n,) [m]; inf: never.

    A point within the body is touched at once if it gets deeper below the side that is nearest to
    it, and not at all if it leaves there.

    Parameters
    ----------
    points
        (n, 2) in `base` [m].
    course
        Where `base` goes; on the spot ways are angles [rad].
    """
    if abs(course.turn) < _STRAIGHT:
        ways = _straight(body, points, course)
    else:
        ways = _on_arc(body, points, course)
    x, y = points.T
    depths = np.array(  # a quarter of the time of stack()
        [body.front_m - x, x - body.rear_m, body.half_width_m - y, body.half_width_m + y]
    )
    inside = depths.min(axis=0) >= -_ROUNDING_M
    if not np.count_nonzero(inside):
        return ways
    # Motion of the point in the body, towards each of the sides.
    ahead, left = _motions(course, points)
    outwards = np.choose(depths.argmin(axis=0), [-ahead, ahead, -left, left])
    return np.where(inside, np.where(outwards < -LEAST_CLOSING, 0.0, math.inf), ways)


def _motions(
    course: Course, points: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the motion of the body at each point, forwards and to the left."""
    x, y = points.T
    return course.ahead - course.turn * y, course.left + course.turn * x


def _straight(body: Rectangle, points: NDArray[np.float64], course: Course) -> NDArray[np.float64]:
    """Return the ways straight on; for a point within the body any number.

    The body holds a point where both of its coordinates lie between two sides.
    """
    enters, leaves = np.full(len(points), -math.inf), np.full(len(points), math.inf)
    sides = (body.rear_m, body.front_m), (-body.half_width_m, body.half_width_m)
    for at, (low, high), share in zip(points.T, sides, course[:2], strict=True):
        if abs(share) < _STANDS:
            enters[(at < low) | (at > high)] = math.inf
            continue
        near, far = (high, low) if share > 0.0 else (low, high)
        enters = np.maximum(enters, (at - near) / share)
        leaves = np.minimum(leaves, (at - far) / share)
    return np.where((enters >= 0.0) & (enters <= leaves), enters, math.inf)


def _on_arc(body: Rectangle, points: NDArray[np.float64], course: Course) -> NDArray[np.float64]:
    """Return the ways on an arc; for a point within the body any number.

    Seen from the body, a point goes round that centre the other way, and meets the body where its
    circle first crosses one of the sides.
    """
    turn = course.turn
    centre_x_m, centre_y_m = -course.left / turn, course.ahead / turn
    x, y = points[:, 0] - centre_x_m, points[:, 1] - centre_y_m
    squares = x * x + y * y
    ends = np.array([[body.rear_m], [body.front_m]]) - centre_x_m
    sides = np.array([[-body.half_width_m], [body.half_width_m]]) - centre_y_m
    with np.errstate(invalid="ignore"):  # nan: a circle that does not reach a side
        across, along = np.sqrt(squares - ends * ends), np.sqrt(squares - sides * sides)
    across, along = np.concatenate([across, -across]), np.concatenate([along, -along])
    # Where each circle crosses the lines of the two ends, twice each, and those of the two sides.
    at_x, at_y = np.empty((8, len(x))), np.empty((8, len(x)))
    at_x[0:2] = at_x[2:4] = ends
    at_x[4:] = along
    at_y[:4] = across
    at_y[4:6] = at_y[6:] = sides
    within_sides = (across >= sides[0]) & (across <= sides[1])
    within_ends = (along >= ends[0]) & (along <= ends[1])
    meets = np.concatenate([within_sides, within_ends])
    ways = np.full(len(x), math.inf)
    met = meets.any(axis=0)
    if np.count_nonzero(met):  # arctan2 is slow, and most circles miss the body
        turned = np.arctan2(y[met], x[met]) - np.arctan2(at_y[:, met], at_x[:, met])
        angles = np.mod(turned * math.copysign(1.0, turn), math.tau)
        ways[met] = np.where(meets[:, met], angles, math.inf).min(axis=0) / abs(turn)
    return ways
