"""Distances of a map's cells from its obstacles, in one byte each.

The squared Euclidean distance transform of Felzenszwalb and Huttenlocher, Distance transforms of
sampled functions, Theory of Computing 8 (2012): distances along columns first, then of each row the
lower envelope of the parabolas that stand on them. What is kept is the number of the squared
distance in `SQUARES`, as a campus has tens of millions of cells: exact up to 20 cells, which is
where a lidar's likelihood ends, and good to 1.5 % beyond.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled

_REACH: Final = 255
"""Distance [cells] from which on all is far."""
_EXACT: Final = 160
"""Number of least distances that are kept as they are."""


def _kept_squares() -> NDArray[np.float64]:
    """Return the squared distances that are kept, (256,) [cells^2], ascending."""
    steps = np.arange(_REACH) ** 2
    attained = np.unique(steps[:, None] + steps)[:_EXACT]
    beyond = np.geomspace(attained[-1], _REACH**2, 256 - _EXACT)[1:]
    return np.concatenate([attained, beyond, [np.inf]])


SQUARES: Final = _kept_squares()
"""Squared distances that a byte stands for, (256,) [cells^2]; the last is all that is far."""
FAR: Final = 255
"""Byte of cells 255 cells from any obstacle, or farther."""
_MIDDLES: Final = (0.5 * (np.sqrt(SQUARES[:-2]) + np.sqrt(SQUARES[1:-1]))) ** 2
_BYTES: Final = np.append(np.searchsorted(_MIDDLES, np.arange(_REACH**2)), FAR).astype(np.uint8)
"""Byte of each squared distance, the last of all from 255 cells on."""


def distance_bytes(occupied: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return how far each cell is from the nearest occupied one, by its number in `SQUARES`.

    Parameters
    ----------
    occupied
        (rows, columns).

    Returns
    -------
    NDArray
        (rows + 2, columns + 2): a border of one cell, which is `FAR`, stands for all that lies
        outside.
    """
    rows, columns = occupied.shape
    found = np.full((rows + 2, columns + 2), FAR, np.uint8)
    _along_columns(occupied, found[1:-1, 1:-1])
    _along_rows(found[1:-1, 1:-1], _BYTES)
    return found


@compiled
def _along_columns(occupied: NDArray[np.bool_], away: NDArray[np.uint8]) -> None:
    """Fill in how far the nearest occupied cell of the column is, at most `_REACH` [cells]."""
    rows, columns = occupied.shape
    for i in range(rows):
        for j in range(columns):
            before = np.int64(away[i - 1, j]) if i > 0 else _REACH
            away[i, j] = 0 if occupied[i, j] else min(before + 1, _REACH)
    for i in range(rows - 2, -1, -1):
        for j in range(columns):
            away[i, j] = min(np.int64(away[i, j]), np.int64(away[i + 1, j]) + 1)


@compiled
def _along_rows(found: NDArray[np.uint8], numbers: NDArray[np.uint8]) -> None:
    """Replace distances along columns by the numbers of squared distances."""
    rows, columns = found.shape
    heights, feet = np.empty(columns, np.int64), np.empty(columns, np.int64)
    begins = np.empty(columns)
    for i in range(rows):
        count = 0
        for j in range(columns):
            away = np.int64(found[i, j])
            if away == _REACH:
                continue
            height = away * away
            # A parabola is lowest from where it crosses the one before; hidden ones go.
            begin = -np.inf
            while count > 0:
                foot = feet[count - 1]
                begin = 0.5 * (height - heights[count - 1] + j * j - foot * foot) / (j - foot)
                if begin > begins[count - 1]:
                    break
                count -= 1
                begin = -np.inf
            heights[count], feet[count], begins[count] = height, j, begin
            count += 1
        at = 0
        for j in range(columns):
            while at + 1 < count and begins[at + 1] < j:
                at += 1
            off = j - feet[at] if count > 0 else _REACH
            square = off * off + (heights[at] if count > 0 else 0)
            found[i, j] = numbers[min(square, len(numbers) - 1)]
