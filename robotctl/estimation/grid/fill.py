"""Free space of one scan in an occupancy grid, as an outline filled row by row.

Coordinates are in cells of the array: x along the columns, y along the rows, cell (r, c) covers
[c, c + 1) x [r, r + 1). Cells hold steps of the log odds, in [-127, 127].

A scan's free space is the union of the fans between neighbouring beams. Filling its rows costs
what its outline is long, with 16 cells and more at a time; walking along each beam costs what the
beams are long, and visits the cells near the sensor once for each beam.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.estimation.grid.config import STEPS

COS, SIN, FREE, ECHO = range(4)
"""Columns of `beams`: direction, free length, and range of the echo [cells]."""
GRAZING = 5.67
"""Neighbouring beams end on one surface, hit at up to atan(5.67) = 80 degrees from its normal, if
their lengths differ by at most this multiple of the distance between them."""

MIRROR = (1 << 31) - 1
"""Odd, and greater than twice any column."""

_NEXT = (1 << 32) - 1
_ALL = np.full((16, 16), 255, np.uint8)
_FROM = np.triu(_ALL).view(np.uint64)
_TO = np.tril(_ALL).view(np.uint64)
"""(16, 2): row k has the bits of cells k to 15, or 0 to k, of a block of 16."""


@compiled
def free_fans(beams: NDArray[np.float64], fan_sin: float, fans: NDArray[np.float64]) -> None:
    """Put into `fans`, (n, 2), how far the fans on either side of each beam reach along it.

    Two beams that end on one surface have free space up to the line between their ends. Else
    something hides between them, and only what is nearer than both ends is free. 0 if there is
    no fan: a beam says nothing, or the angle is wide.
    """
    n = len(beams)
    fans[0, 0] = fans[n - 1, 1] = 0.0
    first_turn = _turn(beams, 0, 1) if n > 2 else 0.0
    for i in range(n):
        j = i + 1
        if j == n:
            # The beams close a circle where the last turns on to the first as the others turn.
            if n < 3 or _turn(beams, i, 0) * first_turn <= 0.0:
                break
            j = 0
        one, other = beams[i, FREE], beams[j, FREE]
        near, far = min(one, other), max(one, other)
        dot = beams[i, COS] * beams[j, COS] + beams[i, SIN] * beams[j, SIN]
        turn = abs(_turn(beams, i, j))
        fans[i, 1] = fans[j, 0] = 0.0
        if near > 0.0 and dot > 0.0 and turn <= fan_sin:
            surface = far - near <= GRAZING * turn * near
            fans[i, 1] = one if surface else near
            fans[j, 0] = other if surface else near


@compiled
def _turn(beams: NDArray[np.float64], i: int, j: int) -> float:
    """Return the sine of the angle from beam i to beam j."""
    return float(beams[i, COS] * beams[j, SIN] - beams[i, SIN] * beams[j, COS])


@compiled
def outline_of(
    x: float,
    y: float,
    beams: NDArray[np.float64],
    fans: NDArray[np.float64],
    corners: NDArray[np.float64],
) -> int:
    """Write the corners of the fans' outline to `corners`, (>= 3 n + 1, 3); return their number.

    Each row is x, y, and 1 or -1 for the side that ends there: the sense in which it goes round.
    Each fan is a triangle with its tip at (x, y). The side that two neighbours share cancels, but
    for the end of the longer one.
    """
    n = len(beams)
    sense = -1.0 if _turn(beams, n - 1, 0) < 0.0 else 1.0
    count = _corner(corners, 0, x, y, beams[0], fans[0, 0], sense)
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        turns_back = _turn(beams, i, j) * sense < 0.0
        if turns_back:
            count = _corner(corners, count, x, y, beams[i], 0.0, sense)
            sense = -sense
        if turns_back or fans[i, 1] != fans[i, 0]:
            count = _corner(corners, count, x, y, beams[i], fans[i, 1], sense)
        count = _corner(corners, count, x, y, beams[j], fans[j, 0], sense)
    return count


@compiled
def _corner(
    corners: NDArray[np.float64],
    count: int,
    x: float,
    y: float,
    beam: NDArray[np.float64],
    away: float,
    sense: float,
) -> int:
    """Append the corner at a distance along a beam; return the new count."""
    corners[count, 0], corners[count, 1] = x + away * beam[COS], y + away * beam[SIN]
    corners[count, 2] = sense
    return count + 1


@compiled
def cross_rows(
    corners: NDArray[np.float64],
    middle_row: int,
    firsts: NDArray[np.int32],
    crossings: NDArray[np.int64],
) -> None:
    """Insert the outline's crossings of the middles of rows into the rows' sorted lists.

    `firsts` holds the place of each row's first crossing in `crossings`, 0 for none. A crossing is
    twice its column, plus 1 if upwards, in the upper 32 bits, and the place of the next below.
    Below the sensor, in rows before `middle_row`, it is `MIRROR` minus that: beams that follow each
    other to the left then put their crossings first in every list, which saves the search.
    """
    new = 0
    px, py = corners[0, 0], corners[0, 1]
    p_row = int(py + 0.5)  # the first row whose middle lies above
    for k in range(1, len(corners)):
        qx, qy = corners[k, 0], corners[k, 1]
        q_row = int(qy + 0.5)
        if q_row != p_row:
            slope = (qx - px) / (qy - py)
            # A side can be so flat that rounding would carry it beyond its ends.
            left, right = min(px, qx), max(px, qx)
            bit = 1 if (q_row > p_row) == (corners[k, 2] > 0.0) else 0
            for row in range(min(p_row, q_row), max(p_row, q_row)):
                x = min(max(px + (row + 0.5 - py) * slope, left), right)
                key = 2 * int(x + 0.5) + bit
                key = (MIRROR - key if row < middle_row else key) << 32
                new += 1
                before, after = 0, int(firsts[row])
                while after > 0 and crossings[after] < key:
                    before, after = after, crossings[after] & _NEXT
                crossings[new] = key + after
                if before > 0:
                    crossings[before] += new - after
                else:
                    firsts[row] = new
        px, py, p_row = qx, qy, q_row


@compiled
def lower_inside(
    cells: NDArray[np.int8],
    firsts: NDArray[np.int32],
    crossings: NDArray[np.int64],
    first_row: int,
    middle_row: int,
    miss: int,
) -> None:
    """Lower each cell whose centre is inside the outlines; empty the lists.

    Whole blocks of 16 cells are lowered, which the processor does at once; cells beyond the ends
    are restored.
    """
    lowest, step = np.int8(miss - STEPS), np.int8(miss)
    words = cells.view(np.uint64)
    for row in range(len(firsts)):
        at = int(firsts[row])
        firsts[row] = 0
        winding = 0
        line, kept = cells[first_row + row], words[first_row + row]
        while at > 0:
            key = crossings[at] >> 32
            at = crossings[at] & _NEXT
            if winding == 0:
                begin = key >> 1
            winding += 1 if key & 1 else -1
            end = key >> 1
            if winding != 0 or end == begin:
                continue
            if row < middle_row:
                begin, end = (MIRROR >> 1) - end, (MIRROR >> 1) - begin
            first, last = begin >> 4 << 1, (end - 1) >> 4 << 1
            first0, first1, last0, last1 = kept[first], kept[first + 1], kept[last], kept[last + 1]
            span = line[8 * first : 8 * last + 16]
            for c in range(len(span)):
                span[c] = np.int8(np.int32(max(span[c], lowest)) - np.int32(step))
            meant0, meant1 = _FROM[begin & 15, 0], _FROM[begin & 15, 1]
            kept[first] = (kept[first] & meant0) | (first0 & ~meant0)
            kept[first + 1] = (kept[first + 1] & meant1) | (first1 & ~meant1)
            meant0, meant1 = _TO[(end - 1) & 15, 0], _TO[(end - 1) & 15, 1]
            kept[last] = (kept[last] & meant0) | (last0 & ~meant0)
            kept[last + 1] = (kept[last + 1] & meant1) | (last1 & ~meant1)
