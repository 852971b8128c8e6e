"""A scan as points on surfaces: where they are, which way they face, how far apart they lie."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.model.geometry.points import moved, rotation
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan

Floats = NDArray[np.float64]

RANGE_LIMIT_M: Final = 30.0
"""Echoes from farther say little: a degree between beams is half a metre there."""
_GAP_M: Final = 0.15
_GAPS: Final = 4.0
"""Neighbours are on one surface within this distance, or so many times their distance on a wall
that faces the lidar."""
_FIT_M: Final = 0.15
_FIT_GAPS: Final = 3.0
_FIT_MOST: Final = 15
_FLAT: Final = 0.15
"""Greatest ratio of thickness to length of a piece of wall."""
_NOISE_M: Final = 0.02
"""Thickness of a wall by the noise of ranges."""
_SPACING_M: Final = 0.05
"""Points that lie closer share their errors, and count less."""

_LEAST_WALLS: Final = 0.3
"""Share of the points that must be of walls for these to speak for all."""


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """The echoes of one or several scans, in one frame.

    Parameters
    ----------
    points
        (n, 2) [m].
    normals
        (n, 2), towards the lidar; zero where no piece of wall is seen.
    weights
        (n,), 0 to 1: less than 1 where points lie close together.
    outline, outline_normals
        Points at most `_SPACING_M` apart along the surfaces, (m, 2) [m], and their normals.
    """

    points: Floats
    normals: Floats
    weights: Floats
    outline: Floats
    outline_normals: Floats

    @property
    def walls(self) -> Surface:
        """The points that are seen to be of a wall; all of them where those are few.

        The others lie far apart, in a pattern that moves with the robot: it matches itself best
        where the robot has not moved.
        """
        is_wall = np.any(self.normals != 0.0, axis=1)
        if np.count_nonzero(is_wall) < _LEAST_WALLS * len(is_wall):
            return self
        return replace(
            self,
            points=self.points[is_wall],
            normals=self.normals[is_wall],
            weights=self.weights[is_wall],
        )

    def moved(self, T_a_b: SE2) -> Surface:
        """Return the surface, given in frame b, in frame a."""
        turn = rotation(T_a_b.theta_rad)
        return Surface(
            moved(T_a_b, self.points),
            self.normals @ turn,
            self.weights,
            moved(T_a_b, self.outline),
            self.outline_normals @ turn,
        )


def joined(surfaces: list[Surface]) -> Surface:
    """Return surfaces of one frame as one."""
    return Surface(
        np.concatenate([each.points for each in surfaces]),
        np.concatenate([each.normals for each in surfaces]),
        np.concatenate([each.weights for each in surfaces]),
        np.concatenate([each.outline for each in surfaces]),
        np.concatenate([each.outline_normals for each in surfaces]),
    )


def surface_of(scan: RangeScan) -> Surface:
    """Return the echoes of a scan in `base`; neighbouring beams must be neighbours in the scan."""
    surfaces = [_of_one(each) for each in scan.parts]
    return joined(surfaces) if scan.others else surfaces[0]


def _of_one(scan: RangeScan) -> Surface:
    limit_m = min(scan.max_range_m, RANGE_LIMIT_M)
    hit = np.flatnonzero(np.isfinite(scan.ranges_m) & (scan.ranges_m < limit_m))
    sensor = np.array([scan.x_m, scan.y_m])
    angles, ranges = scan.angles_rad[hit], scan.ranges_m[hit]
    points = sensor + ranges[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    step_rad = beam_step_rad(scan.angles_rad)
    is_linked = _linked(points, ranges, hit, step_rad)
    normals = np.zeros_like(points)
    weights = np.ones(len(points))
    _fit(points, ranges, is_linked, step_rad, sensor, normals, weights)
    return Surface(points, normals, weights, *_outline(points, normals, is_linked))


def beam_step_rad(angles: Floats) -> float:
    """Return the median angle between neighbouring beams (n,) [rad]; 0 where there are none.

    For a few hundred beams `np.median` takes several times as long.
    """
    steps = np.sort(np.abs(angles[1:] - angles[:-1]))
    if len(steps) == 0:
        return 0.0
    return 0.5 * float(steps[(len(steps) - 1) // 2] + steps[len(steps) // 2])


@compiled
def corners(points: Floats) -> tuple[Floats, Floats]:
    """Return the least and the greatest coordinates of points (n, 2), each (2,); n > 0."""
    low, high = points[0].copy(), points[0].copy()
    for k in range(1, len(points)):
        for axis in range(2):
            low[axis] = min(low[axis], points[k, axis])
            high[axis] = max(high[axis], points[k, axis])
    return low, high


@compiled
def _linked(
    points: Floats, ranges: Floats, beams: NDArray[np.int64], step_rad: float
) -> NDArray[np.bool_]:
    """Return whether each point and the next are on one surface, (n,); False for the last."""
    result = np.zeros(len(points), np.bool_)
    for i in range(len(points) - 1):
        gap = np.hypot(points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1])
        wide = _GAPS * step_rad * min(ranges[i], ranges[i + 1])
        result[i] = beams[i + 1] - beams[i] <= 2 and gap < max(_GAP_M, wide)
    return result


@compiled
def _fit(  # noqa: C901 - one compiled loop
    points: Floats, ranges: Floats, is_linked: NDArray[np.bool_], step_rad: float, sensor: Floats,
    normals: Floats, weights: Floats,
) -> None:  # fmt: skip
    """Fit a line to the neighbours of each point; fill normals and weights."""
    count = len(points)
    for i in range(count):
        reach = max(_FIT_M, _FIT_GAPS * step_rad * ranges[i] * 1.5)
        first = i
        while first > 0 and i - first < _FIT_MOST and is_linked[first - 1]:
            dx, dy = points[first - 1] - points[i]
            if np.hypot(dx, dy) > reach:
                break
            first -= 1
        last = i
        while last < count - 1 and last - i < _FIT_MOST and is_linked[last]:
            dx, dy = points[last + 1] - points[i]
            if np.hypot(dx, dy) > reach:
                break
            last += 1
        n = last - first + 1
        if n >= 2:
            length = np.hypot(
                points[last, 0] - points[first, 0], points[last, 1] - points[first, 1]
            )
            weights[i] = min(1.0, length / (n - 1) / _SPACING_M)
        if n < 3:
            continue
        mx = my = 0.0
        for k in range(first, last + 1):
            mx += points[k, 0]
            my += points[k, 1]
        mx, my = mx / n, my / n
        xx = xy = yy = 0.0
        for k in range(first, last + 1):
            dx, dy = points[k, 0] - mx, points[k, 1] - my
            xx += dx * dx
            xy += dx * dy
            yy += dy * dy
        half = 0.5 * np.arctan2(2.0 * xy, xx - yy)  # direction of the line
        c, s = np.cos(half), np.sin(half)
        along = (c * c * xx + 2.0 * c * s * xy + s * s * yy) / n
        across = max((s * s * xx - 2.0 * c * s * xy + c * c * yy) / n, 0.0)
        if np.sqrt(across) > _FLAT * np.sqrt(along) or np.sqrt(across) > 2.0 * _NOISE_M:
            continue
        nx, ny = -s, c
        if nx * (sensor[0] - points[i, 0]) + ny * (sensor[1] - points[i, 1]) < 0.0:
            nx, ny = -nx, -ny
        normals[i, 0], normals[i, 1] = nx, ny


@compiled
def _outline(
    points: Floats, normals: Floats, is_linked: NDArray[np.bool_]
) -> tuple[Floats, Floats]:
    """Return the points, and points between those on one surface; with their normals."""
    count = 0
    for i in range(len(points)):
        count += 1
        if is_linked[i]:
            gap = np.hypot(points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1])
            count += int(gap / _SPACING_M)
    result, facing = np.empty((count, 2)), np.empty((count, 2))
    at = 0
    for i in range(len(points)):
        result[at], facing[at] = points[i], normals[i]
        at += 1
        if is_linked[i]:
            gap = np.hypot(points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1])
            between = int(gap / _SPACING_M)
            for k in range(between):
                share = (k + 1) / (between + 1)
                for axis in range(2):
                    result[at, axis] = points[i, axis] + share * (
                        points[i + 1, axis] - points[i, axis]
                    )
                facing[at] = normals[i] if share < 0.5 else normals[i + 1]
                at += 1
    return result, facing
