"""Pieces of a scan that hang together, and which of their points came to where it was free.

What a lidar sees of a wall changes as the robot drives: its end moves as far as something in front
of it hides it, and a piece of it seems to move. But no point of it ever lies where an earlier scan
saw through. Points of what really moves do. So earlier scans are kept, each as the range that it
saw in each direction, the least of the beams beside it (compare the virtual scans of Petrovskaya
and Thrun, "Model based vehicle detection and tracking", 2009).
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import borrows, compiled

DIRECTIONS: Final = 1440
"""Number of directions in which an earlier scan is kept."""
_PER_RAD: Final = DIRECTIONS / math.tau
_BESIDE_M: Final = 0.03
"""Width by which the noise of both scans may widen what the earlier one saw [m]."""
_NEAR_M: Final = 0.1
"""Range below which that angle grows no more [m]."""
MEAN: Final = math.pi / 4.0
"""Distance from a disc's middle to the mean of its visible side, towards the sensor [radii]."""

_SIGMA_M: Final = 0.02
"""Standard deviation of a segment's middle by noise [m]."""
_ONE_LEG_M: Final = 0.08
_TWO_LEGS_M: Final = 0.045
"""The same of a person of whom one leg is seen, or both [m]."""


class PieceRules(NamedTuple):
    """The settings that the kernels need, each as in `TracksConfig`."""

    margin_m: float
    person_width_m: float
    leg_width_m: float
    stride_m: float


X, Y, RADIUS, POINTS, NEW, SIGMA = range(6)
"""Columns of segments: the middle and radius [m], how many points it has, how many of those came
to where it was free, and the standard deviation of its middle along either axis [m]."""


@compiled
def ranges_by_direction(
    bearings: NDArray[np.float64], ranges: NDArray[np.float64], max_range: float
) -> NDArray[np.float32]:
    """Return the least range near each direction, (`DIRECTIONS`,) [m]; nan where no beam goes.

    Each beam counts up to its neighbours and a little beyond, so that nothing hides between two of
    them.

    Parameters
    ----------
    bearings, ranges
        (n,) of the beams in their order [rad, m]; inf: nothing within `max_range`.
    """
    least = np.full(DIRECTIONS, np.nan, np.float32)
    n = len(bearings)
    for i in range(n):
        if math.isnan(ranges[i]):
            continue
        before, after = bearings[max(i - 1, 0)], bearings[min(i + 1, n - 1)]
        away = np.float32(min(ranges[i], max_range))
        beside = _BESIDE_M / max(ranges[i], _NEAR_M)
        low = min(before, after, bearings[i]) - beside
        high = max(before, after, bearings[i]) + beside
        for k in range(math.floor(low * _PER_RAD), math.floor(high * _PER_RAD) + 1):
            j = k % DIRECTIONS
            if not least[j] <= away:
                least[j] = away
    return least


@compiled
@borrows
def came_lately(
    x: float,
    y: float,
    sensors: NDArray[np.float64],
    scans: NDArray[np.float32],
    margin: float,
    free_scans: int,
) -> bool:
    """Return whether a place was free in earlier scans, oldest first, until something came there.

    Parameters
    ----------
    sensors, scans
        (k, 2) places [m], and (k, `DIRECTIONS`).
    margin, free_scans
        `margin_m` and `free_scans` of `TracksConfig`.
    """
    free = 0
    for k in range(len(sensors)):
        dx, dy = x - sensors[k, 0], y - sensors[k, 1]
        saw = scans[k, math.floor(math.atan2(dy, dx) * _PER_RAD) % DIRECTIONS]
        away = math.hypot(dx, dy)
        if saw > away + margin:
            free += 1
        elif saw >= away - margin:
            break
    return free >= free_scans


@compiled
def segments_of(
    points: NDArray[np.float64],
    counts: NDArray[np.bool_],
    x: float,
    y: float,
    spacing: float,
    sensors: NDArray[np.float64],
    scans: NDArray[np.float32],
    rules: PieceRules,
    free_scans: int,
) -> NDArray[np.float64]:
    """Return the pieces of a scan that may be a person, (m, 6): see the columns.

    Parameters
    ----------
    points, counts
        (n, 2) in the order of the beams [m], and which of them count.
    x, y
        The sensor [m].
    spacing
        Angle between two beams [rad].
    sensors, scans
        Earlier scans, see `came_lately`.
    rules, free_scans
        Settings.
    """
    found = np.empty((len(points), 6))
    m, begin, last = 0, -1, -1
    for i in range(len(points) + 1):
        ends = i == len(points)
        if not ends and not counts[i]:
            continue
        if begin >= 0 and not ends:
            away = math.hypot(points[i, 0] - x, points[i, 1] - y)
            step = math.hypot(points[i, 0] - points[last, 0], points[i, 1] - points[last, 1])
            if step <= rules.margin_m + 3.0 * spacing * away:
                last = i
                continue
        if begin >= 0 and _piece(points, counts, begin, last, x, y, spacing, rules, found[m]):
            for j in range(begin, last + 1):
                if counts[j] and came_lately(
                    points[j, 0], points[j, 1], sensors, scans, rules.margin_m, free_scans
                ):
                    found[m, NEW] += 1.0
            m += 1
        begin, last = i, i
    return _pairs(found[:m], rules)


@compiled
@borrows
def _piece(
    points: NDArray[np.float64],
    counts: NDArray[np.bool_],
    begin: int,
    last: int,
    x: float,
    y: float,
    spacing: float,
    rules: PieceRules,
    out: NDArray[np.float64],
) -> bool:
    """Write the segment of some points as if it were a disc; return whether it may be a person."""
    width = math.hypot(points[last, 0] - points[begin, 0], points[last, 1] - points[begin, 1])
    if width > rules.person_width_m:
        return False
    n, mean_x, mean_y = 0, 0.0, 0.0
    for j in range(begin, last + 1):
        if counts[j]:
            n += 1
            mean_x += points[j, 0]
            mean_y += points[j, 1]
    mean_x /= n
    mean_y /= n
    away = max(math.hypot(mean_x - x, mean_y - y), 1e-6)
    beam = spacing * away
    radius = 0.5 * (width + beam)
    out[X] = mean_x + MEAN * radius * (mean_x - x) / away
    out[Y] = mean_y + MEAN * radius * (mean_y - y) / away
    out[RADIUS], out[POINTS], out[NEW] = radius, n, 0.0
    # Beams end anywhere within their distance; a single leg goes ahead of its person or behind.
    out[SIGMA] = (
        _ONE_LEG_M if width + beam < rules.leg_width_m else math.hypot(_SIGMA_M, 0.3 * beam)
    )
    return True


@compiled
def _pairs(found: NDArray[np.float64], rules: PieceRules) -> NDArray[np.float64]:
    """Join legs that are near each other."""
    n = len(found)
    partner = np.full(n, -1)
    for i in range(n):
        best = rules.stride_m
        for j in range(n):
            away = math.hypot(found[i, X] - found[j, X], found[i, Y] - found[j, Y])
            small = 2.0 * max(found[i, RADIUS], found[j, RADIUS]) < rules.leg_width_m
            if i != j and small and away < best:
                best, partner[i] = away, j
    joined = np.empty((n, 6))
    m = 0
    for i in range(n):
        j = partner[i]
        if j >= 0 and partner[j] == i:
            if j < i:
                continue
            away = math.hypot(found[i, X] - found[j, X], found[i, Y] - found[j, Y])
            for k in (X, Y):
                joined[m, k] = 0.5 * (found[i, k] + found[j, k])
            joined[m, SIGMA] = _TWO_LEGS_M
            joined[m, RADIUS] = 0.5 * away + max(found[i, RADIUS], found[j, RADIUS])
            joined[m, POINTS] = found[i, POINTS] + found[j, POINTS]
            joined[m, NEW] = found[i, NEW] + found[j, NEW]
        else:
            joined[m] = found[i]
        m += 1
    return joined[:m]
