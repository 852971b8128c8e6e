"""Distances from blocked cells, kept up to date where cells change.

A cell that changes is felt only within `reach` cells, so distances are no longer than that:
tiles of the map within reach of a change are noted, and only they are worked out again, from the
blocked cells in and around them. That takes two passes, exact and Euclidean: first along the
columns, then the smallest sum of squares along each row (Saito, Toriwaki 1994; Felzenszwalb,
Huttenlocher 2012).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import borrows, compiled

TILE: Final = 16
"""Side of a tile [cells]."""


class Clearance:
    """Distances of a map whose blocked cells change.

    Parameters
    ----------
    blocked
        (rows, columns), which others change; they note the tiles within reach in `stale`.
    cells
        (rows, columns): from each cell's centre to the nearest edge of a blocked cell or of the
        map [cells], as `clearance_of` gives it; it is written here.
    reach
        Distances between centres are at most this [cells].
    """

    def __init__(self, blocked: NDArray[np.bool_], cells: NDArray[np.float32], reach: int) -> None:
        self._blocked, self._cells, self.reach = blocked, cells, reach
        rows, columns = blocked.shape
        self.stale = np.ones((-(-rows // TILE), -(-columns // TILE)), np.bool_)
        """Tiles whose distances are out of date."""

    def refresh(self, first: tuple[int, int], last: tuple[int, int]) -> None:
        """Bring a window up to date: from a cell to another, row and column, both included."""
        tiles = self.stale[
            first[0] // TILE : last[0] // TILE + 1, first[1] // TILE : last[1] // TILE + 1
        ]
        down, right = (np.flatnonzero(tiles.any(axis=axis)) for axis in (1, 0))
        if not len(down):
            return
        row, column = first[0] // TILE, first[1] // TILE
        measure(
            self._blocked,
            self._cells,
            TILE * (row + int(down[0])),
            TILE * (row + int(down[-1]) + 1),
            TILE * (column + int(right[0])),
            TILE * (column + int(right[-1]) + 1),
            self.reach,
        )
        tiles[down[0] : down[-1] + 1, right[0] : right[-1] + 1] = False


@compiled
def measure(
    blocked: NDArray[np.bool_],
    clearance: NDArray[np.float32],
    row0: int,
    row1: int,
    column0: int,
    column1: int,
    reach: int,
) -> None:
    """Write the clearance of the cells from one row and column on to before others."""
    rows, columns = blocked.shape
    row1, column1 = min(row1, rows), min(column1, columns)
    left, right = max(column0 - reach, 0), min(column1 + reach, columns)
    height, width = row1 - row0, column1 - column0
    away = np.empty((height, right - left), np.int32)
    _along_columns(blocked, away, row0, left, reach)
    # Integers: the compiler takes eight of them at a time, but not eight floats to compare.
    out = np.empty(width, np.int32)
    for i in range(height):
        line = away[i]
        nearest = reach
        for j in range(len(line)):
            nearest = min(nearest, line[j])
            line[j] = np.int32(line[j] * line[j])
        out[:] = np.int32(reach * reach)
        for shift in range(-reach + 1, reach) if nearest < reach else range(0):
            first = max(0, left - column0 - shift)
            last = max(min(width, right - column0 - shift), first)
            square = np.int32(shift * shift)
            source, target = line[column0 - left + shift + first :], out[first:last]
            for j in range(len(target)):
                target[j] = min(target[j], np.int32(source[j] + square))
        for j in range(width):
            edge = min(column0 + j + 1, columns - column0 - j)
            square = np.int32(min(out[j], edge * edge))
            clearance[row0 + i, column0 + j] = np.sqrt(np.float32(square)) - np.float32(0.5)


@compiled
def _along_columns(
    blocked: NDArray[np.bool_], away: NDArray[np.int32], row0: int, left: int, reach: int
) -> None:
    """Write how far the nearest blocked cell or edge of the map is above or below [cells]."""
    rows = blocked.shape[0]
    height, width = away.shape
    last = np.empty(width, np.int32)
    last[:] = 0 if row0 < reach else reach
    for row in range(max(row0 - reach, 0), row0 + height):
        _one_further(blocked[row, left : left + width], last, reach)
        if row >= row0:
            away[row - row0] = last
    last[:] = 0 if row0 + height + reach > rows else reach
    for row in range(min(row0 + height + reach, rows) - 1, row0 - 1, -1):
        _one_further(blocked[row, left : left + width], last, reach)
        if row < row0 + height:
            line = away[row - row0]
            for j in range(width):
                line[j] = min(line[j], last[j])


@compiled
@borrows
def _one_further(blocked: NDArray[np.bool_], last: NDArray[np.int32], reach: int) -> None:
    """Replace the distances of a row by those of the next."""
    for j in range(len(last)):
        step = np.int32(min(last[j] + 1, reach))
        last[j] = np.int32(0) if blocked[j] else step
