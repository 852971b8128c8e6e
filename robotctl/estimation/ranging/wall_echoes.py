"""How far a sonar measures in a room of straight walls.

An echo comes back from a point of a wall that lies in the cone of the sonar and that the sound
meets at no more than the incidence limit beta from the wall's normal, from either side. With p the
distance of the wall's line and delta the angle from the normal at which a ray leaves, the ray meets
the line at p / cos(delta), which is

    m = ((By - Ay)(Ax - x) - (Bx - Ax)(Ay - y)) / ((By - Ay) cos(theta) - (Bx - Ax) sin(theta)),

and q = p tan(delta) along the line from the foot of the normal. Cone, incidence limit and the ends
A and B each allow an interval of q; the nearest point of what they have in common is the one with
the least abs(q). No angle is computed, and a wall parallel to the cone's axis is no special case.

Concave corners of about 90 degrees send sound back where it came from, at any incidence. Of all
these points the nearest counts that no other wall hides. If the nearest point of a wall is hidden,
the rest of that wall does not count either, which errs if something narrow stands in front of it.
"""

from __future__ import annotations

import copy
import math
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import borrows, compiled
from robotctl.estimation.ranging.segment_index import NearIndex
from robotctl.estimation.ranging.sonar_cones import SonarCones
from robotctl.model.wall_map import WallMap

_Indexed: TypeAlias = tuple[
    NDArray[np.float64], NDArray[np.int64], NDArray[np.int32], NDArray[np.float64]
]
"""Walls or corners, and the lists of those near each cell."""

_TOUCH_M: Final = 1e-6
"""Distance within which the end of a wall lies on another [m]: rounding."""
_SQUARE: Final = 0.5
"""Corners whose arms have at most this cosine between them send sound back: 60 to 120 degrees."""
_INSET_M: Final = 1e-3
"""The last millimetre of a wall does not count: at an outer corner it would stand for the side of
a box that cannot be seen."""
_BEFORE: Final = 1.0 - 1e-6
"""An obstacle beyond this share of the distance is the reflecting wall itself."""


class WallEchoes:
    """Ranges of a ring of sonars in a room of walls.

    Parameters
    ----------
    walls
        The room.
    cones
        The sonars.
    """

    def __init__(self, walls: WallMap, cones: SonarCones) -> None:
        mounts, max_range_m = cones.mounts, cones.max_range_m
        self._mounts = np.column_stack([mounts[:, :2], np.cos(mounts[:, 2]), np.sin(mounts[:, 2])])
        self._lines = _lines(walls.segments)
        self._corners = inner_corners(walls)
        radius_m = float(np.hypot(mounts[:, 0], mounts[:, 1]).max(initial=0.0))
        self._limits = np.array(
            [
                math.cos(0.5 * cones.beam_rad),
                math.sin(0.5 * cones.beam_rad),
                math.tan(cones.max_incidence_rad),
                max_range_m,
                radius_m,
            ]
        )
        points = np.hstack([self._corners[:, :2], self._corners[:, :2]])
        reach_m = max_range_m + radius_m
        self._index = NearIndex(walls.segments, reach_m)
        self._corner_index = NearIndex(points, reach_m, self._index)

    def with_limit(self, max_incidence_rad: float) -> WallEchoes:
        """Return the same sonars with another incidence limit, in (0, pi/2) [rad]."""
        other = copy.copy(self)
        other._limits = self._limits.copy()
        other._limits[2] = math.tan(max_incidence_rad)
        return other

    def ranges(self, poses: NDArray[np.float64], sonars: NDArray[np.intp]) -> NDArray[np.float64]:
        """Return what sonars should measure at poses, see `Echoes.ranges`."""
        found = np.empty((len(poses), len(sonars)))
        _ring(
            poses,
            self._mounts[sonars],
            self._index.cells_of(poses),
            (self._lines, *self._index.lists),
            (self._corners, *self._corner_index.lists),
            self._limits,
            found,
        )
        return found


def _lines(segments: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return A, the unit vector to B, and the length of each wall, (m, 5)."""
    along = segments[:, 2:] - segments[:, :2]
    length = np.hypot(along[:, 0], along[:, 1])[:, np.newaxis]
    return np.ascontiguousarray(np.hstack([segments[:, :2], along / length, length]))


def inner_corners(walls: WallMap) -> NDArray[np.float64]:
    """Return corners where the end of a wall meets another one at 60 to 120 degrees.

    Returns
    -------
    NDArray
        (c, 6): x, y [m] and the unit vectors of the two arms. A wall that ends at the middle of
        another makes two corners.
    """
    lines = _lines(walls.segments)
    a, unit, length = lines[:, :2], lines[:, 2:4], lines[:, 4]
    ends = np.concatenate([a, a + length[:, np.newaxis] * unit])
    arms = np.concatenate([unit, -unit])
    offset = ends[:, np.newaxis] - a  # (ends, walls, 2)
    along = np.sum(offset * unit, axis=2)
    aside = np.abs(offset[..., 0] * unit[:, 1] - offset[..., 1] * unit[:, 0])
    touches = (aside < _TOUCH_M) & (along > -_TOUCH_M) & (along < length + _TOUCH_M)
    touches &= np.abs(arms @ unit.T) <= _SQUARE
    found = []
    for sign, reaches in ((1.0, along < length - _TOUCH_M), (-1.0, along > _TOUCH_M)):
        end, wall = np.nonzero(touches & reaches)
        # The corner of two ends is met twice, once from each; kept where its arms turn left.
        left = _cross(arms[end], sign * unit[wall]) > 0.0
        middle = (along[end, wall] > _TOUCH_M) & (along[end, wall] < length[wall] - _TOUCH_M)
        kept = left | middle
        found.append(np.hstack([ends[end], arms[end], sign * unit[wall]])[kept])
    return np.concatenate(found)


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the cross product of vectors (n, 2), (n,)."""
    product: NDArray[np.float64] = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return product


@compiled
@borrows
def _ring(
    poses: NDArray[np.float64],
    mounts: NDArray[np.float64],
    cells: NDArray[np.intp],
    walls: _Indexed,
    corners: _Indexed,
    limits: NDArray[np.float64],
    found: NDArray[np.float64],
) -> None:
    """Fill `found`, (poses, sonars)."""
    for i in range(len(poses)):
        cos, sin = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        for k in range(len(mounts)):
            sx = poses[i, 0] + cos * mounts[k, 0] - sin * mounts[k, 1]
            sy = poses[i, 1] + sin * mounts[k, 0] + cos * mounts[k, 1]
            ax = cos * mounts[k, 2] - sin * mounts[k, 3]
            ay = sin * mounts[k, 2] + cos * mounts[k, 3]
            found[i, k] = _nearest(sx, sy, ax, ay, cells[i], walls, corners, limits)


@compiled
@borrows
def _nearest(
    sx: float,
    sy: float,
    ax: float,
    ay: float,
    cell: int,
    walls: _Indexed,
    corners: _Indexed,
    limits: NDArray[np.float64],
) -> float:
    """Return the distance of the nearest point that sends an echo and is not hidden, or inf.

    Walls and corners come nearest first, so that most are never looked at.
    """
    lines, starts, numbers, bounds = walls
    points, point_starts, point_numbers, point_bounds = corners
    near, bound = numbers[starts[cell] : starts[cell + 1]], bounds[starts[cell] : starts[cell + 1]]
    best, radius = limits[3], limits[4]
    for m in range(len(near)):
        if bound[m] - radius >= best:
            break
        p, q, nx, ny = _on_wall(sx, sy, ax, ay, lines, near[m], limits, best)
        distance = math.sqrt(p * p + q * q)
        if distance < best:
            px, py = sx + p * nx - q * ny, sy + p * ny + q * nx
            if not _hidden(sx, sy, px, py, distance + radius, lines, near, bound):
                best = distance
    for m in range(point_starts[cell], point_starts[cell + 1]):
        if point_bounds[m] - radius >= best:
            break
        distance = _to_corner(sx, sy, ax, ay, points, point_numbers[m], limits[0])
        if distance < best:
            px, py = points[point_numbers[m], 0], points[point_numbers[m], 1]
            if not _hidden(sx, sy, px, py, distance + radius, lines, near, bound):
                best = distance
    return best if best < limits[3] else np.inf


@compiled
@borrows
def _on_wall(
    sx: float,
    sy: float,
    ax: float,
    ay: float,
    lines: NDArray[np.float64],
    wall: int,
    limits: NDArray[np.float64],
    best: float,
) -> tuple[float, float, float, float]:
    """Return p, q and the normal to a wall's nearest reflecting point.

    p is inf if the wall has none that is nearer than `best`.
    """
    cos_h, sin_h, tan_limit = limits[0], limits[1], limits[2]
    dx, dy = lines[wall, 0] - sx, lines[wall, 1] - sy
    nx, ny = -lines[wall, 3], lines[wall, 2]
    p = dx * nx + dy * ny
    if p < 0.0:  # the other side of the wall
        nx, ny, p = -nx, -ny, -p
    # Axis along the normal and along the wall; then the cone's edges, clockwise one first.
    a_n, a_t = ax * nx + ay * ny, ay * nx - ax * ny
    low_n, high_n = cos_h * a_n + sin_h * a_t, cos_h * a_n - sin_h * a_t
    if p <= 0.0 or p >= best or (low_n <= 0.0 and high_n <= 0.0):
        return np.inf, 0.0, nx, ny
    one = dy * nx - dx * ny
    other = one + lines[wall, 4] * (lines[wall, 3] * nx - lines[wall, 2] * ny)
    low = max(min(one, other) + _INSET_M, -p * tan_limit)
    high = min(max(one, other) - _INSET_M, p * tan_limit)
    if low > high:
        return np.inf, 0.0, nx, ny
    if low_n > 0.0:
        low = max(low, p * (cos_h * a_t - sin_h * a_n) / low_n)
    if high_n > 0.0:
        high = min(high, p * (cos_h * a_t + sin_h * a_n) / high_n)
    if low > high:
        return np.inf, 0.0, nx, ny
    return p, min(max(0.0, low), high), nx, ny


@compiled
@borrows
def _to_corner(
    sx: float,
    sy: float,
    ax: float,
    ay: float,
    corners: NDArray[np.float64],
    c: int,
    cos_h: float,
) -> float:
    """Return the distance of a corner in the cone that is seen from between its arms, or inf."""
    dx, dy = corners[c, 0] - sx, corners[c, 1] - sy
    along, squared = dx * ax + dy * ay, dx * dx + dy * dy
    if along <= 0.0 or along * along < cos_h * cos_h * squared:
        return np.inf
    ux, uy, vx, vy = corners[c, 2], corners[c, 3], corners[c, 4], corners[c, 5]
    turn = ux * vy - uy * vx
    # -d = a u + b v with a, b > 0
    between = (dy * vx - dx * vy) * turn > 0.0 and (dx * uy - dy * ux) * turn > 0.0
    return math.sqrt(squared) if between else np.inf


@compiled
@borrows
def _hidden(
    sx: float,
    sy: float,
    px: float,
    py: float,
    reach: float,
    lines: NDArray[np.float64],
    near: NDArray[np.int32],
    bound: NDArray[np.float64],
) -> bool:
    """Whether one of the near walls stands between a sonar and a point."""
    wx, wy = px - sx, py - sy
    for m in range(len(near)):
        if bound[m] > reach:
            return False
        wall = near[m]
        ex, ey = lines[wall, 2], lines[wall, 3]
        across = wx * ey - wy * ex
        if across == 0.0:
            continue
        dx, dy = lines[wall, 0] - sx, lines[wall, 1] - sy
        way, along = (dx * ey - dy * ex) / across, (dx * wy - dy * wx) / across
        if 0.0 < way < _BEFORE and 0.0 <= along <= lines[wall, 4]:
            return True
    return False
