"""Inner loops of the occupancy grid: the evidence of one scan, or one sonar, for each cell.

Coordinates are in cells: x along the columns, y along the rows, cell (r, c) covers [c, c + 1) x
[r, r + 1). Evidence and cells are steps of the stored log odds, in [-127, 127].

Within a scan a cell changes once, without being marked: cells treated singly are computed from
their old values before the free space is filled and written afterwards, the stronger rule last.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.estimation.grid.config import STEPS
from robotctl.estimation.grid.fill import (
    COS,
    ECHO,
    FREE,
    SIN,
    cross_rows,
    free_fans,
    lower_inside,
    outline_of,
)

MARGIN = math.sqrt(0.5)
"""Half a cell's diagonal [cells]."""


class Space(NamedTuple):
    """Working memory for one scan.

    `firsts` and `crossings` are the lists of `cross_rows`, the lists empty; `fans` and `corners` as
    of `free_fans` and `outline_of`; `single` the indices of cells treated singly, and `became`
    their new values.
    """

    firsts: NDArray[np.int32]
    crossings: NDArray[np.int64]
    fans: NDArray[np.float64]
    corners: NDArray[np.float64]
    single: NDArray[np.int64]
    became: NDArray[np.int8]


@compiled
def measure_scans(
    ranges_m: NDArray[np.float64],
    max_ranges_m: NDArray[np.float64],
    starts: NDArray[np.int64],
    ends: NDArray[np.int64],
    pattern: NDArray[np.float64],
    poses: NDArray[np.float64],
    side_m: float,
    range_limit_m: float,
    no_echo_m: float,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return each beam's free length and echo, and the cells that each scan reaches.

    Free space ends half a cell's diagonal before an echo: a cell counts as nearer only if all of it
    is nearer.

    Parameters
    ----------
    ranges_m
        (b,) of all scans, one after the other [m].
    ends
        (n,) index behind each scan's last beam.
    pattern, starts
        (p, 2) cos and sin of directions in the sensor's frame, and (n,) where each scan's begin.
    poses, max_ranges_m
        (n, 4) of each sensor: x and y [cells], cos and sin of its heading; (n,) its reach [m].
    side_m, range_limit_m, no_echo_m
        Side of a cell, and the configuration's limits [m].

    Returns
    -------
    beams : (b, 4)
        cos and sin of the direction, free length and range of the echo [cells]; negative if there
        is none.
    bounds : (n, 4) [cells]
        First row and column, and the row and column after the last, with a margin of one cell.
    """
    beams = np.empty((len(ranges_m), 4))
    bounds = np.empty((len(ends), 4), np.int64)
    begin = 0
    for k in range(len(ends)):
        x, y, c, s = poses[k]
        left, right, low, high = x, x, y, y
        for i in range(begin, ends[k]):
            range_m = ranges_m[i]
            away = pattern[starts[k] + i - begin]
            cos, sin = c * away[0] - s * away[1], s * away[0] + c * away[1]
            free, echo = -1.0, -1.0
            if range_m < max_ranges_m[k] and range_m <= range_limit_m:
                echo = range_m / side_m
                free = max(0.0, echo - MARGIN)
            elif not math.isnan(range_m):
                free_m = no_echo_m if math.isinf(range_m) else range_limit_m
                free = min(free_m, max_ranges_m[k]) / side_m
            beams[i, COS], beams[i, SIN], beams[i, FREE], beams[i, ECHO] = cos, sin, free, echo
            length = max(0.0, free, echo)
            end_x, end_y = x + length * cos, y + length * sin
            left, right = min(left, end_x), max(right, end_x)
            low, high = min(low, end_y), max(high, end_y)
        bounds[k, 0], bounds[k, 1] = math.floor(low) - 1, math.floor(left) - 1
        bounds[k, 2], bounds[k, 3] = math.floor(high) + 2, math.floor(right) + 2
        begin = ends[k]
    return beams, bounds


@compiled
def add_scans(
    cells: NDArray[np.int8],
    corner: NDArray[np.int64],
    ends: NDArray[np.int64],
    poses: NDArray[np.float64],
    beams: NDArray[np.float64],
    bounds: NDArray[np.int64],
    fan_sin: float,
    hit: int,
    miss: int,
) -> None:
    """Add scans one after the other.

    Parameters
    ----------
    cells
        (rows, columns) log odds [steps]; contains all that the scans reach; columns a multiple of
        16.
    corner
        Row and column of the first of `cells`, in the numbers of poses and bounds.
    ends, poses, beams, bounds
        As of `measure_scans`.
    fan_sin
        Sine of the largest angle between two beams whose gap is filled.
    hit, miss
        Evidence of an echo and of a beam that passes [steps], both > 0.
    """
    space = _space_for(ends, beams, bounds)
    begin = 0
    for k in range(len(ends)):
        if ends[k] > begin:
            _add_scan(
                cells,
                poses[k, 0] - corner[1],
                poses[k, 1] - corner[0],
                beams[begin : ends[k]],
                bounds[k, 0] - corner[0],
                bounds[k, 2] - bounds[k, 0],
                space,
                fan_sin,
                hit,
                miss,
            )
        begin = ends[k]


@compiled
def _space_for(
    ends: NDArray[np.int64], beams: NDArray[np.float64], bounds: NDArray[np.int64]
) -> Space:
    """Return working memory large enough for each of the scans."""
    rows, most, reach, begin = 0, 0, 0.0, 0
    for k in range(len(ends)):
        reached = 0.0
        for i in range(begin, ends[k]):
            reached += max(0.0, beams[i, FREE])
        rows, most = max(rows, bounds[k, 2] - bounds[k, 0]), max(most, ends[k] - begin)
        reach, begin = max(reach, reached), ends[k]
    # No side of the outline crosses more rows than its two ends are away from the sensor, and no
    # beam passes more than 1.5 cells for each cell of its length, and a few.
    return Space(
        np.zeros(rows, np.int32),
        np.empty(int(4.0 * reach) + 4 * most + 1, np.int64),
        np.empty((most, 2)),
        np.empty((3 * most + 1, 3)),
        np.empty(int(1.5 * reach) + 4 * most, np.int64),
        np.empty(int(1.5 * reach) + 4 * most, np.int8),
    )


@compiled
def _add_scan(
    cells: NDArray[np.int8],
    x: float,
    y: float,
    beams: NDArray[np.float64],
    first_row: int,
    rows: int,
    space: Space,
    fan_sin: float,
    hit: int,
    miss: int,
) -> None:
    """Add one scan, which reaches no more than `rows` rows from `first_row` on."""
    n = len(beams)
    flat = cells.reshape(-1)
    fans, single, became = space.fans, space.single, space.became
    free_fans(beams, fan_sin, fans[:n])
    count = 0
    for i in range(n):
        # The part of a beam inside a fan is filled with the fan; only the rest is walked.
        begin = max(fans[i, 0], fans[i, 1])
        if beams[i, FREE] > begin:
            count = _walk(cells, x, y, beams[i], begin, miss, single, became, count)
    for i in range(n):
        echo = beams[i, ECHO]
        if echo >= 0.0:
            column, row = int(x + echo * beams[i, COS]), int(y + echo * beams[i, SIN])
            single[count] = row * cells.shape[1] + column
            became[count] = min(cells[row, column] + hit, STEPS)
            count += 1
    # The free space is filled after the single cells were computed from their old values.
    corners = outline_of(x, y - first_row, beams, fans, space.corners)
    middle = int(y - first_row)
    cross_rows(space.corners[:corners], middle, space.firsts, space.crossings)
    lower_inside(cells, space.firsts[:rows], space.crossings, first_row, middle, miss)
    for i in range(count):
        flat[single[i]] = became[i]


@compiled
def _walk(
    cells: NDArray[np.int8],
    x: float,
    y: float,
    beam: NDArray[np.float64],
    begin: float,
    miss: int,
    single: NDArray[np.int64],
    became: NDArray[np.int8],
    count: int,
) -> int:
    """Note each cell that a beam passes, from `begin` to its end; return the new count.

    The exact traversal of Amanatides and Woo, "A fast voxel traversal algorithm" (1987).
    """
    dx, dy, end = beam[COS], beam[SIN], beam[FREE]
    column, row = math.floor(x + begin * dx), math.floor(y + begin * dy)
    right, up = dx > 0.0, dy > 0.0
    per_column = abs(1.0 / dx)  # inf along an axis
    per_row = abs(1.0 / dy)
    at_column = (column + right - x) / dx if dx != 0.0 else math.inf
    at_row = (row + up - y) / dy if dy != 0.0 else math.inf
    while True:
        single[count] = row * cells.shape[1] + column
        became[count] = max(cells[row, column] - miss, -STEPS)
        count += 1
        if min(at_column, at_row) >= end:
            return count
        if at_column < at_row:
            column += 1 if right else -1
            at_column += per_column
        else:
            row += 1 if up else -1
            at_row += per_row


@compiled
def add_cone(
    cells: NDArray[np.int8],
    x: float,
    y: float,
    heading_rad: float,
    half_width_rad: float,
    distance: float,
    band: float,
    echo: bool,
    hit: int,
    miss: int,
) -> None:
    """Add one sonar at (x, y): free before `distance`, occupied around it if there is an echo.

    Parameters
    ----------
    cells
        (rows, columns) log odds [steps]; contains the cone.
    heading_rad, half_width_rad
        Axis of the cone in the array's frame, and half its opening [rad].
    distance, band
        Range, and half the thickness of the arc that counts as occupied [cells].
    echo
        Whether there was an echo at that range.
    hit, miss
        Evidence [steps], both > 0.
    """
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    opening = math.tan(half_width_rad)
    far = distance + band
    low, high = max(0, int(y - far - 1.0)), min(cells.shape[0], int(y + far + 2.0))
    left, right = max(0, int(x - far - 1.0)), min(cells.shape[1], int(x + far + 2.0))
    for row in range(low, high):
        dy = row + 0.5 - y
        for column in range(left, right):
            dx = column + 0.5 - x
            along, aside = c * dx + s * dy, abs(c * dy - s * dx)
            # Near its tip the cone is thinner than a cell: a strip of one cell along the axis.
            if along <= 0.0 or aside > max(0.5, opening * along):
                continue
            away = math.hypot(dx, dy)
            if away < distance - band:
                cells[row, column] = max(cells[row, column] - miss, -STEPS)
            elif echo and away <= far:
                cells[row, column] = min(cells[row, column] + hit, STEPS)
