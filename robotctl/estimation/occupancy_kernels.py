"""The inner loops of the occupancy grid: what one scan says of which cells.

Coordinates are in cells of the array: x along the columns, y along the rows, cell (r, c) covers
[c, c + 1) x [r, r + 1). Evidence and cells are steps of the stored log odds, in [-127, 127].

A scan's free space is the union of the fans between neighbouring beams. Filling its rows costs
what its outline is long, with the cells 32 or 64 at a time; walking along each beam costs what the
beams are long, and visits the cells near the sensor once for each beam.

Within a scan a cell changes once, without any mark in it: cells that are treated singly are
computed from their old values before the fans are filled and written after, the stronger rule last.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.compiled import compiled
from robotctl.estimation.occupancy_config import STEPS

LIMIT = STEPS
MARGIN = math.sqrt(0.5)
"""Half a cell's diagonal [cells]."""
GRAZING = 5.67
"""Neighbouring beams end on one surface that is met at up to atan(5.67) = 80 degrees from square:
the longer one is longer by at most so many times the distance between them."""


@compiled
def measure_scans(
    ranges_m: NDArray[np.float64],
    max_ranges_m: NDArray[np.float64],
    ends: NDArray[np.int64],
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    cos: NDArray[np.float64],
    sin: NDArray[np.float64],
    side_m: float,
    range_limit_m: float,
    no_echo_m: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Return how far each beam says free, where it has its echo, and what each scan needs.

    Free space ends half a cell's diagonal before an echo: nearer than the echo is a cell that lies
    nearer as a whole.

    Parameters
    ----------
    ranges_m, cos, sin
        (b,) beams of all scans: ranges [m], and directions in the grid's frame.
    max_ranges_m, x, y
        (n,) of each scan: range of the sensor [m] and its place [cells].
    ends
        (n,) index behind each scan's last beam.
    side_m, range_limit_m, no_echo_m
        Side of a cell, and the configuration's limits [m].

    Returns
    -------
    reaches, echoes : (b,) [cells]
        Negative where there is none.
    bounds : (n, 4) [cells]
        First row and column, and the rows and columns behind the last, with a cell to spare.
    """
    reaches, echoes = np.full(len(ranges_m), -1.0), np.full(len(ranges_m), -1.0)
    bounds = np.empty((len(x), 4), np.int64)
    begin = 0
    for k in range(len(x)):
        left, right, low, high = x[k], x[k], y[k], y[k]
        for i in range(begin, ends[k]):
            range_m = ranges_m[i]
            if math.isnan(range_m):
                continue
            if range_m >= max_ranges_m[k] or range_m > range_limit_m:
                free_m = no_echo_m if math.isinf(range_m) else range_limit_m
                length = min(free_m, max_ranges_m[k], range_m) / side_m
                reaches[i] = length
            else:
                length = range_m / side_m
                reaches[i] = max(0.0, length - MARGIN)
                echoes[i] = length
            end_x, end_y = x[k] + length * cos[i], y[k] + length * sin[i]
            left, right = min(left, end_x), max(right, end_x)
            low, high = min(low, end_y), max(high, end_y)
        bounds[k, 0], bounds[k, 1] = math.floor(low) - 1, math.floor(left) - 1
        bounds[k, 2], bounds[k, 3] = math.floor(high) + 2, math.floor(right) + 2
        begin = ends[k]
    return reaches, echoes, bounds


@compiled
def add_scans(
    cells: NDArray[np.int8],
    ends: NDArray[np.int64],
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    cos: NDArray[np.float64],
    sin: NDArray[np.float64],
    reaches: NDArray[np.float64],
    echoes: NDArray[np.float64],
    rows: NDArray[np.int64],
    fan_sin: float,
    hit: int,
    miss: int,
) -> None:
    """Add scans one after the other.

    Parameters
    ----------
    cells
        (rows, columns) log odds [steps]; holds all that the scans reach.
    ends, x, y, cos, sin, reaches, echoes
        As of `measure_scans`, with x and y in the array.
    rows
        (n, 2): first row of the array that a scan reaches, and the row behind the last.
    fan_sin
        Sine of the greatest angle between beams that are filled between.
    hit, miss
        Evidence of an echo and of a beam that passes [steps], both > 0.
    """
    height, beams, begin = 0, 0, 0
    for k in range(len(x)):
        height, beams = max(height, rows[k, 1] - rows[k, 0]), max(beams, ends[k] - begin)
        begin = ends[k]
    crossings = np.empty((height, 4 * beams + 4), np.int32)
    counts = np.zeros(height, np.int32)
    begin = 0
    for k in range(len(x)):
        end = ends[k]
        _add_scan(
            cells,
            x[k],
            y[k],
            cos[begin:end],
            sin[begin:end],
            reaches[begin:end],
            echoes[begin:end],
            rows[k, 0],
            crossings,
            counts[: rows[k, 1] - rows[k, 0]],
            fan_sin,
            hit,
            miss,
        )
        begin = end


@compiled
def _add_scan(
    cells: NDArray[np.int8],
    x: float,
    y: float,
    cos: NDArray[np.float64],
    sin: NDArray[np.float64],
    reaches: NDArray[np.float64],
    echoes: NDArray[np.float64],
    first_row: int,
    crossings: NDArray[np.int32],
    counts: NDArray[np.int32],
    fan_sin: float,
    hit: int,
    miss: int,
) -> None:
    """Add one scan, with a work space for the rows from `first_row` on."""
    n = len(reaches)
    if n == 0:
        return
    flat = cells.reshape(-1)
    fans = _fans(cos, sin, reaches, fan_sin)
    passed = 0.0
    for i in range(n):
        passed += max(0.0, reaches[i] - max(fans[i, 0], fans[i, 1]))
    single = np.empty(int(1.5 * passed) + 4 * n, np.int64)
    became = np.empty(len(single), np.int8)
    count = 0
    for i in range(n):
        begin = max(fans[i, 0], fans[i, 1])
        if reaches[i] > begin:
            count = _walk(
                cells, x, y, cos[i], sin[i], begin, reaches[i], miss, single, became, count
            )
    for i in range(n):
        if echoes[i] >= 0.0:
            column, row = int(x + echoes[i] * cos[i]), int(y + echoes[i] * sin[i])
            single[count] = row * cells.shape[1] + column
            became[count] = min(cells[row, column] + hit, LIMIT)
            count += 1
    _outline(x, y - first_row, cos, sin, fans, crossings, counts)
    _fill(cells, crossings, counts, first_row, miss)
    for i in range(count):
        flat[single[i]] = became[i]


@compiled
def _fans(
    cos: NDArray[np.float64],
    sin: NDArray[np.float64],
    reaches: NDArray[np.float64],
    fan_sin: float,
) -> NDArray[np.float64]:
    """Return how far the fans beside each beam reach along it, (n, 2): before and after the beam.

    Two beams that end on one surface have free space up to the line between their ends. Else
    something hides between them, and only what is nearer than both ends is free. 0 where there is
    no fan: a beam says nothing, or the angle is wide.
    """
    n = len(reaches)
    fans = np.zeros((n, 2))
    first_turn = _turn(cos, sin, 0, 1) if n > 2 else 0.0
    for i in range(n):
        j = i + 1
        if j == n:
            # The beams close a circle where the last turns on to the first as the others turn.
            if n < 3 or _turn(cos, sin, i, 0) * first_turn <= 0.0:
                break
            j = 0
        near, far = min(reaches[i], reaches[j]), max(reaches[i], reaches[j])
        dot = cos[i] * cos[j] + sin[i] * sin[j]
        turn = abs(_turn(cos, sin, i, j))
        if near > 0.0 and dot > 0.0 and turn <= fan_sin:
            surface = far - near <= GRAZING * turn * near
            fans[i, 1] = reaches[i] if surface else near
            fans[j, 0] = reaches[j] if surface else near
    return fans


@compiled
def _turn(cos: NDArray[np.float64], sin: NDArray[np.float64], i: int, j: int) -> float:
    """Return the sine of the angle from beam i to beam j."""
    return float(cos[i] * sin[j] - sin[i] * cos[j])


@compiled
def _outline(
    x: float,
    y: float,
    cos: NDArray[np.float64],
    sin: NDArray[np.float64],
    fans: NDArray[np.float64],
    crossings: NDArray[np.int32],
    counts: NDArray[np.int32],
) -> None:
    """Note where the outlines of the fans cross the middles of rows.

    Each fan is a triangle with its tip at (x, y). The side that two neighbours share cancels, but
    for the end of the longer one.
    """
    n = len(fans)
    clockwise = n > 1 and _turn(cos, sin, n - 1, 0) < 0.0
    px, py = x + fans[0, 0] * cos[0], y + fans[0, 0] * sin[0]
    p_row = int(py + 0.5)
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        turns_back = (_turn(cos, sin, i, j) < 0.0) != clockwise
        if turns_back:
            _cross(px, py, p_row, x, y, int(y + 0.5), clockwise, crossings, counts)
            clockwise = not clockwise
            px, py, p_row = x, y, int(y + 0.5)
        if turns_back or fans[i, 1] != fans[i, 0]:
            qx, qy = x + fans[i, 1] * cos[i], y + fans[i, 1] * sin[i]
            q_row = int(qy + 0.5)
            if q_row != p_row:
                _cross(px, py, p_row, qx, qy, q_row, clockwise, crossings, counts)
            px, py, p_row = qx, qy, q_row
        qx, qy = x + fans[j, 0] * cos[j], y + fans[j, 0] * sin[j]
        q_row = int(qy + 0.5)
        if q_row != p_row:
            _cross(px, py, p_row, qx, qy, q_row, clockwise, crossings, counts)
        px, py, p_row = qx, qy, q_row


@compiled
def _cross(
    x0: float,
    y0: float,
    row0: int,
    x1: float,
    y1: float,
    row1: int,
    backwards: bool,
    crossings: NDArray[np.int32],
    counts: NDArray[np.int32],
) -> None:
    """Put a side's crossings into the rows' sorted lists: twice the column, plus 1 if upwards.

    The side goes from (x0, y0) to (x1, y1); `row0` is the first row whose middle lies above y0.
    """
    slope = (x1 - x0) / (y1 - y0)
    bit = 1 if (row1 > row0) != backwards else 0
    begin = x0 + (0.5 - y0) * slope + 0.5
    for row in range(min(row0, row1), max(row0, row1)):
        key = 2 * int(begin + row * slope) + bit
        line = crossings[row]
        place = counts[row]
        counts[row] = place + 1
        while place > 0 and line[place - 1] > key:
            line[place] = line[place - 1]
            place -= 1
        line[place] = key


@compiled
def _fill(
    cells: NDArray[np.int8],
    crossings: NDArray[np.int32],
    counts: NDArray[np.int32],
    first_row: int,
    miss: int,
) -> None:
    """Lower each cell whose centre the outlines go round."""
    lowest = np.int8(miss - LIMIT)
    step = np.int8(miss)
    for row in range(len(counts)):
        winding = 0
        for i in range(counts[row]):
            if winding == 0:
                begin = crossings[row, i] >> 1
            winding += 1 if crossings[row, i] & 1 else -1
            if winding == 0:
                span = cells[first_row + row, begin : crossings[row, i] >> 1]
                for c in range(len(span)):
                    span[c] = np.int8(np.int32(max(span[c], lowest)) - np.int32(step))
        counts[row] = 0


@compiled
def _walk(
    cells: NDArray[np.int8],
    x: float,
    y: float,
    dx: float,
    dy: float,
    begin: float,
    end: float,
    miss: int,
    single: NDArray[np.int64],
    became: NDArray[np.int8],
    count: int,
) -> int:
    """Note each cell that a beam passes between two distances; return the new count.

    The exact traversal of Amanatides and Woo, "A fast voxel traversal algorithm" (1987).
    """
    column, row = math.floor(x + begin * dx), math.floor(y + begin * dy)
    right, up = dx > 0.0, dy > 0.0
    per_column = abs(1.0 / dx)  # inf along an axis
    per_row = abs(1.0 / dy)
    at_column = (column + right - x) / dx if dx != 0.0 else math.inf
    at_row = (row + up - y) / dy if dy != 0.0 else math.inf
    while True:
        single[count] = row * cells.shape[1] + column
        became[count] = max(cells[row, column] - miss, -LIMIT)
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
        (rows, columns) log odds [steps]; holds the cone.
    heading_rad, half_width_rad
        Axis of the cone in the array's frame, and half its opening [rad].
    distance, band
        Range, and half the thickness of the arc that counts as being there [cells].
    echo
        Whether there is something at the range.
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
                cells[row, column] = max(cells[row, column] - miss, -LIMIT)
            elif echo and away <= far:
                cells[row, column] = min(cells[row, column] + hit, LIMIT)
