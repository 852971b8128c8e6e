"""How near a wall is, cell by cell, with bounds over blocks of cells."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.compiled import compiled
from robotctl.estimation.slam.front_end.surface import Floats

RESOLUTION_M: Final = 0.05
SIGMA_M: Final = 0.07
"""Of the score of a point by its distance to a wall: the width of the peak of the search."""
LEVELS: Final = 5
"""The cells of the coarsest are 2^4 times as wide."""
_REACH: Final = 3
"""Cells around a wall that get a score."""
_MARGIN: Final = 20
"""More than a coarsest cell: what lies beyond is out of reach of all blocks."""


@dataclass(frozen=True, slots=True, eq=False)
class ScoreField:
    """Scores 0 to 255 of cells, and for coarser levels the greatest of blocks.

    A cell of level h > 0 has the greatest score of the block of 2^h x 2^h cells, and of the blocks
    right of it, above it and across: where a point may get to by a shift of less than a block.

    Parameters
    ----------
    x_m, y_m
        Corner of the first cell [m].
    cells
        All levels, one after the other, row by row.
    begins, rows, columns
        Of each level, (LEVELS,).
    """

    x_m: float
    y_m: float
    cells: NDArray[np.uint8]
    begins: NDArray[np.int64]
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]


def score_field(outline: Floats) -> ScoreField:
    """Return the field of walls given as points (m, 2), which lie as close as cells; m > 0."""
    low = np.floor(outline.min(axis=0) / RESOLUTION_M).astype(np.int64) - _MARGIN
    high = np.floor(outline.max(axis=0) / RESOLUTION_M).astype(np.int64) + _MARGIN + 1
    width, height = (int(each) for each in high - low)
    sides = 1 << np.arange(LEVELS)
    rows = -(-height // sides)
    columns = -(-width // sides)
    sizes = rows * columns
    begins = np.cumsum(sizes) - sizes
    cells = np.zeros(int(sizes.sum()), np.uint8)
    steps = np.arange(-_REACH, _REACH + 1) * RESOLUTION_M
    stamp = 255.0 * np.exp(-0.5 * (steps[:, None] ** 2 + steps**2) / SIGMA_M**2)
    x_m, y_m = (float(each) * RESOLUTION_M for each in low)
    _draw(outline, x_m, y_m, width, stamp.astype(np.uint8), cells)
    _pool(cells, begins, rows, columns)
    return ScoreField(x_m, y_m, cells, begins, rows, columns)


@compiled
def _draw(
    outline: Floats, x_m: float, y_m: float, width: int, stamp: NDArray[np.uint8],
    cells: NDArray[np.uint8],
) -> None:  # fmt: skip
    """Draw the finest level."""
    for k in range(len(outline)):
        column = int((outline[k, 0] - x_m) / RESOLUTION_M)
        row = int((outline[k, 1] - y_m) / RESOLUTION_M)
        middle = row * width + column
        if cells[middle] == 255:
            continue
        for i in range(2 * _REACH + 1):
            begin = middle + (i - _REACH) * width - _REACH
            for j in range(2 * _REACH + 1):
                cells[begin + j] = max(cells[begin + j], stamp[i, j])


@compiled
def _pool(
    cells: NDArray[np.uint8], begins: NDArray[np.int64], rows: NDArray[np.int64],
    columns: NDArray[np.int64],
) -> None:  # fmt: skip
    """Fill the coarser levels: first each block, then with its neighbours."""
    for level in range(1, len(begins)):
        fine, coarse = begins[level - 1], begins[level]
        width, wide = columns[level - 1], columns[level]
        for row in range(rows[level - 1]):
            for column in range(width):
                value = cells[fine + row * width + column]
                at = coarse + (row >> 1) * wide + (column >> 1)
                cells[at] = max(cells[at], value)
    for level in range(1, len(begins)):
        begin, high, wide = begins[level], rows[level], columns[level]
        for row in range(high):
            for column in range(wide):
                at = begin + row * wide + column
                value = cells[at]
                if column + 1 < wide:
                    value = max(value, cells[at + 1])
                if row + 1 < high:
                    value = max(value, cells[at + wide])
                    if column + 1 < wide:
                        value = max(value, cells[at + wide + 1])
                cells[at] = value
