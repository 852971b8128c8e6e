"""How near a wall is, cell by cell, with bounds over blocks of cells."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.estimation.slam.front_end.surface import Floats, corners

RESOLUTION_M: Final = 0.05
SIGMA_M: Final = 0.07
"""Standard deviation in a point's score by its distance to a wall [m]: the width of the peak."""
LEVELS: Final = 6
"""The last has the greatest scores of blocks of 2^5 x 2^5 cells."""
_REACH: Final = 3
"""Cells around a wall that get a score."""
_MARGIN: Final = (1 << (LEVELS - 1)) + _REACH
"""Cells around the walls: a block that begins farther off has no score."""


@dataclass(frozen=True, slots=True, eq=False)
class ScoreField:
    """Scores 0 to 255 of cells, and for coarser levels the greatest of blocks.

    A cell of level h has the greatest score of the block of 2^h x 2^h cells that begins with it and
    goes to the right and up: where a point may get to by shifts of less than 2^h cells.

    Parameters
    ----------
    x_m, y_m
        Corner of the first cell [m].
    cells
        (LEVELS, rows, columns). All that is outside has the score 0.
    """

    x_m: float
    y_m: float
    cells: NDArray[np.uint8]


def score_field(outline: Floats) -> ScoreField:
    """Return the field of walls given as points (m, 2), which lie as close as cells; m > 0."""
    low, high = (np.floor(each / RESOLUTION_M).astype(np.int64) for each in corners(outline))
    low, high = low - _MARGIN, high + _MARGIN + 1
    columns, rows = (int(each) for each in high - low)
    cells = np.zeros((LEVELS, rows, columns), np.uint8)
    steps = np.arange(-_REACH, _REACH + 1) * RESOLUTION_M
    stamp = 255.0 * np.exp(-0.5 * (steps[:, None] ** 2 + steps**2) / SIGMA_M**2)
    x_m, y_m = (float(each) * RESOLUTION_M for each in low)
    _draw(outline, x_m, y_m, stamp.astype(np.uint8), cells[0])
    for level in range(1, LEVELS):
        # A block is four of the level below.
        side, fine = 1 << (level - 1), cells[level - 1]
        wide = np.maximum(fine[:, :-side], fine[:, side:])
        np.maximum(wide[:-side], wide[side:], out=cells[level, :-side, :-side])
    return ScoreField(x_m, y_m, cells)


@compiled
def _draw(
    outline: Floats, x_m: float, y_m: float, stamp: NDArray[np.uint8], cells: NDArray[np.uint8]
) -> None:
    """Draw the finest level."""
    for k in range(len(outline)):
        column = int((outline[k, 0] - x_m) / RESOLUTION_M)
        row = int((outline[k, 1] - y_m) / RESOLUTION_M)
        if cells[row, column] == 255:
            continue
        for i in range(2 * _REACH + 1):
            for j in range(2 * _REACH + 1):
                y, x = row + i - _REACH, column + j - _REACH
                cells[y, x] = max(cells[y, x], stamp[i, j])
