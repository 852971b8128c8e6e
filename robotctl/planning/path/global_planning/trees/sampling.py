"""Regions in which a tree may grow: the cells around its start, narrow passages among them."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled

_NARROW: Final = 6
"""A passage up to this wide is narrow [cells]."""


@compiled
def cells_around(
    clearance: NDArray[np.float32], radius: float, row: int, column: int
) -> tuple[NDArray[np.bool_], NDArray[np.int32]]:
    """Return which cells a circle can reach side by side from one of them, and a list of those.

    Parameters
    ----------
    clearance
        (rows, columns).
    radius
        Of the circle: the least clearance of a cell.
    row, column
        Where it is.

    Returns
    -------
    reached, cells
        (rows, columns), and (n, 2) rows and columns; none if the circle does not fit there.
    """
    rows, columns = clearance.shape
    reached = np.zeros((rows, columns), np.bool_)
    cells = np.empty((rows * columns, 2), np.int32)
    count = 0
    if clearance[row, column] >= radius:
        reached[row, column] = True
        cells[0, 0], cells[0, 1] = row, column
        count = 1
    done = 0
    while done < count:
        at_row, at_column = cells[done, 0], cells[done, 1]
        done += 1
        for down, right in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            r, c = at_row + down, at_column + right
            inside = 0 <= r < rows and 0 <= c < columns
            if inside and not reached[r, c] and clearance[r, c] >= radius:
                reached[r, c] = True
                cells[count, 0], cells[count, 1] = r, c
                count += 1
    return reached, cells[:count].copy()


@compiled
def narrow_cells(reached: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Return the cells, (n, 2), with walls on two opposite sides, near by: the bridge test.

    Hsu, Jiang, Reif, Sun, "The bridge test for sampling narrow passages", 2003.
    """
    rows, columns = reached.shape
    passable, is_narrow = reached.ravel(), np.zeros(rows * columns, np.bool_)
    for r in range(rows):
        _mark_short_runs(passable, is_narrow, r * columns, 1, columns)
    for c in range(columns):
        _mark_short_runs(passable, is_narrow, c, columns, rows)
    cells = np.empty((is_narrow.sum(), 2), np.int32)
    count = 0
    for i in range(len(is_narrow)):
        if is_narrow[i]:
            cells[count, 0], cells[count, 1] = i // columns, i % columns
            count += 1
    return cells


@compiled
def _mark_short_runs(
    passable: NDArray[np.bool_], marks: NDArray[np.bool_], first: int, step: int, count: int
) -> None:
    """Mark the cells of a row or column that lie in short runs of passable ones."""
    begin = 0
    for k in range(count + 1):
        if k < count and passable[first + k * step]:
            continue
        if k - begin <= _NARROW:
            for j in range(begin, k):
                marks[first + j * step] = True
        begin = k + 1
