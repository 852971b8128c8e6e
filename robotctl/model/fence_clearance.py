"""Clearance between a robot's body and its fence, at many poses at once."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robotctl.model.fence import Fence, FenceCircle, FencePolygon
from robotctl.model.footprint import Footprint
from robotctl.model.footprint_arrays import OFFSET, PIECE, side_rows
from robotctl.model.polygons import sides_of

_TINY: Final = 1e-300


class _Side(NamedTuple):
    """Sides of a polygon in `base` at some poses, from a to b, (n, k) each [m]."""

    ax: NDArray[np.float64]
    ay: NDArray[np.float64]
    bx: NDArray[np.float64]
    by: NDArray[np.float64]

    def distance(self, x_m: float, y_m: float) -> NDArray[np.float64]:
        """Return the distance of a point of `base` from the nearest side, (n,) [m]."""
        ux, uy = self.bx - self.ax, self.by - self.ay
        px, py = x_m - self.ax, y_m - self.ay
        along = (px * ux + py * uy) / np.maximum(ux * ux + uy * uy, _TINY)
        along = np.clip(along, 0.0, 1.0)
        away = np.hypot(px - along * ux, py - along * uy)
        nearest: NDArray[np.float64] = away.min(axis=1, initial=math.inf)
        return nearest

    def surround(self, x_m: float, y_m: float) -> NDArray[np.bool_]:
        """Return whether a point of `base` is inside the polygon, (n,)."""
        across = (self.ay > y_m) != (self.by > y_m)
        rise = np.where(across, self.by - self.ay, 1.0)
        at = self.ax + (y_m - self.ay) / rise * (self.bx - self.ax)
        inside: NDArray[np.bool_] = np.count_nonzero(across & (at > x_m), axis=1) % 2 == 1
        return inside

    def chosen(self, which: NDArray[np.bool_]) -> _Side:
        """Return some of the sides, (k,)."""
        return _Side(*(each[:, which] for each in self))

    def at(self, which: NDArray[np.bool_]) -> _Side:
        """Return the sides at some of the poses, (n,)."""
        return _Side(*(each[which] for each in self))


def body_clearance(
    fence: Fence, body: Footprint, poses: NDArray[np.float64], cap_m: float = math.inf
) -> NDArray[np.float64]:
    """Return the distance of the body from the fence at poses of `base` in `world`, (n,) [m].

    Positive, up to `cap_m`, for a body within the allowed area. Negative for one that sticks out:
    its depth, or, with `base` outside, the body's reach plus the distance of `base` back.

    The poses are those of one motion, near to each other; sides farther than `cap_m` from all of
    them cost little.

    Parameters
    ----------
    poses
        Poses, (n, 3): x, y [m], heading [rad].
    """
    clearance = np.full(len(poses), cap_m)
    for polygon in fence.polygons:
        clearance = np.minimum(clearance, _from_polygon(polygon, body, poses, cap_m))
    for circle in fence.circles:
        clearance = np.minimum(clearance, _from_circle(circle, body, poses))
    return clearance


def _from_polygon(
    polygon: FencePolygon, body: Footprint, poses: NDArray[np.float64], cap_m: float
) -> NDArray[np.float64]:
    """Return the clearance from one polygon."""
    here = _sides(polygon, poses[:1])
    spread_m = float(np.hypot(*(poses[:, :2] - poses[0, :2]).T).max(initial=0.0))
    near = _each_distance(here) <= spread_m + body.reach_m + cap_m
    is_allowed = bool(here.surround(0.0, 0.0)[0]) == polygon.keeps_in
    sides = _sides(polygon, poses)
    if not near.any() and is_allowed:
        return np.full(len(poses), cap_m)
    around = sides.chosen(near)
    outline = _outline_distance(around, body)
    crosses = _crosses(around, body)
    if is_allowed and not crosses.any():
        return outline
    # Only for a robot that is, or was, beyond the fence.
    surrounded = sides.surround(0.0, 0.0)
    allowed = surrounded if polygon.keeps_in else ~surrounded
    clearance = np.where(crosses, 0.0, outline)
    if crosses.any():
        clearance[crosses] = -_depth(polygon, sides.at(crosses), body)
    way_back = body.reach_m + sides.distance(0.0, 0.0)
    return np.where(allowed, clearance, -way_back)


def _sides(polygon: FencePolygon, poses: NDArray[np.float64]) -> _Side:
    """Return the sides of a polygon in `base` at each pose."""
    corners = np.array(polygon.corners)
    away_x = corners[:, 0] - poses[:, :1]
    away_y = corners[:, 1] - poses[:, 1:2]
    cos, sin = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
    x, y = cos * away_x + sin * away_y, cos * away_y - sin * away_x
    return _Side(x, y, np.roll(x, -1, axis=1), np.roll(y, -1, axis=1))


def _each_distance(sides: _Side) -> NDArray[np.float64]:
    """Return the distance of `base` from each side at the first pose, (k,) [m]."""
    ax, ay, bx, by = (each[0] for each in sides)
    ux, uy = bx - ax, by - ay
    along = np.clip(-(ax * ux + ay * uy) / np.maximum(ux * ux + uy * uy, _TINY), 0.0, 1.0)
    distance: NDArray[np.float64] = np.hypot(ax + along * ux, ay + along * uy)
    return distance


def _outline_distance(sides: _Side, body: Footprint) -> NDArray[np.float64]:
    """Return the distance of the body from the nearest side that does not cross it, (n,) [m].

    The nearest points of two disjoint convex shapes, here of a piece and a side, are a corner of
    one of them and any point of the other.
    """
    away = _away(body, sides.ax, sides.ay)
    distance: NDArray[np.float64] = away.min(axis=1, initial=math.inf)
    for corner in body.points:
        distance = np.minimum(distance, sides.distance(*corner))
    return distance


def _crosses(sides: _Side, body: Footprint) -> NDArray[np.bool_]:
    """Return whether one of the sides has a point in the body, (n,)."""
    meets = np.zeros(len(sides.ax), np.bool_)
    for rows in _pieces(body):
        meets |= _crosses_piece(sides, rows)
    return meets


@lru_cache(maxsize=8)
def _pieces(body: Footprint) -> list[NDArray[np.float64]]:
    """Return the sides of each convex piece of a body: normal and distance from `base`, (k, 3).

    They are kept: the control loop asks several times a tick.
    """
    rows = side_rows(body)
    return [rows[rows[:, PIECE] == number, : OFFSET + 1] for number in range(len(body.pieces))]


def _crosses_piece(sides: _Side, rows: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether one of the sides has a point in a convex piece, (n,).

    The side is clipped to the inner half-plane of each side of the piece (Cyrus and Beck, Computers
    and Graphics 3, 1978).
    """
    enter, leave = np.zeros_like(sides.ax), np.ones_like(sides.ax)
    for nx, ny, offset in rows:
        way = nx * (sides.bx - sides.ax) + ny * (sides.by - sides.ay)
        left = offset - nx * sides.ax - ny * sides.ay
        beside = np.where(left >= 0.0, math.inf, -math.inf)
        along = np.abs(way) < _TINY
        at = np.where(along, beside, left / np.where(along, 1.0, way))
        enter = np.maximum(enter, np.where(way < 0.0, at, 0.0))
        leave = np.minimum(leave, np.where(way < 0.0, 1.0, at))
    meets: NDArray[np.bool_] = np.any(enter <= leave, axis=1)
    return meets


def _depth(polygon: FencePolygon, sides: _Side, body: Footprint) -> NDArray[np.float64]:
    """Return the depth by which the body sticks out across a side, (n,) [m], >= 0."""
    depth = np.zeros(len(sides.ax))
    for corner in body.points:
        is_in = sides.surround(*corner) == polygon.keeps_in
        depth = np.maximum(depth, np.where(is_in, 0.0, sides.distance(*corner)))
    inside = -_outside(body, sides.ax, sides.ay)
    deepest: NDArray[np.float64] = np.maximum(depth, inside.max(axis=1, initial=0.0))
    return deepest


def _from_circle(
    circle: FenceCircle, body: Footprint, poses: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the clearance from one circle."""
    away_x, away_y = circle.x_m - poses[:, 0], circle.y_m - poses[:, 1]
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x, y = cos * away_x + sin * away_y, cos * away_y - sin * away_x
    base = np.hypot(x, y)
    if circle.keeps_in:
        corners = [np.hypot(x - each[0], y - each[1]) for each in body.points]
        clearance = circle.radius_m - np.max(corners, axis=0)
        way_back = base - circle.radius_m
    else:
        clearance = _away(body, x, y) - circle.radius_m
        way_back = circle.radius_m - base
    return np.where(way_back > 0.0, -(body.reach_m + way_back), clearance)


def _outside(
    body: Footprint, x: NDArray[np.float64], y: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return how far points of `base` lie outside of the farthest side; negative: inside [m].

    Of several pieces, that of which they lie least outside counts.
    """
    least = np.full_like(x, math.inf)
    for rows in _pieces(body):
        outside = np.full_like(x, -math.inf)
        for nx, ny, offset in rows:
            outside = np.maximum(outside, nx * x + ny * y - offset)
        least = np.minimum(least, outside)
    return least


def _away(body: Footprint, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance of points of `base` from the body [m], 0 within."""
    away = np.full_like(x, math.inf)
    for (ax, ay), (bx, by) in (side for each in body.outlines for side in sides_of(each)):
        ux, uy = bx - ax, by - ay
        along = np.clip(((x - ax) * ux + (y - ay) * uy) / (ux * ux + uy * uy), 0.0, 1.0)
        away = np.minimum(away, np.hypot(x - ax - along * ux, y - ay - along * uy))
    return np.where(_outside(body, x, y) <= 0.0, 0.0, away)
