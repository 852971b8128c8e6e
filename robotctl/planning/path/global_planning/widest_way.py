"""The widest way between two cells: that whose narrowest place has the most room."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.planning.path.global_planning.heap import pop, push

_STEP: Final = 1e-7
"""Cost of a step [cells], below any difference in width: of equally wide ways the shorter wins."""


def widest_way(
    clearance: NDArray[np.float32], start: tuple[int, int], goal: tuple[int, int]
) -> tuple[float, tuple[int, int]] | None:
    """Return half the width of the widest way [cells] and its narrowest place, the first of them.

    Cells are taken in the order of the room on the best way to them, as by Dijkstra's algorithm
    with the least of the way in place of its length (Pollack, Operations Research 8(5), 1960).
    Ways go from side to side of cells, as diagonal steps need both.

    Parameters
    ----------
    clearance
        (rows, columns) [cells], at most 0 where nothing can be.
    start, goal
        Row and column.

    Returns
    -------
    None: no way joins the two.
    """
    columns = clearance.shape[1]
    ends = (row * columns + column for row, column in (start, goal))
    place = int(_narrowest(clearance, *ends))
    if place < 0:
        return None
    cell = place // columns, place % columns
    return float(clearance[cell]), cell


@compiled
def _narrowest(clearance: NDArray[np.float32], start: int, goal: int) -> int:
    """Return the cell with the least room on the widest way; -1: there is none."""
    rows, columns = clearance.shape
    room = clearance.ravel()
    narrowest = np.full(room.size, -1, np.int32)  # on the way to each cell
    steps = np.zeros(room.size, np.int32)
    keys, items = np.empty(room.size), np.empty(room.size, np.int32)
    count = 0
    if room[start] > 0.0 and room[goal] > 0.0:
        narrowest[start] = start
        count = push(keys, items, count, -float(room[start]), start)
    while count > 0:
        cell = pop(keys, items, count)
        count -= 1
        if cell == goal:
            return int(narrowest[cell])
        row, column = cell // columns, cell % columns
        for down, right in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            if not (0 <= row + down < rows and 0 <= column + right < columns):
                continue
            to = cell + down * columns + right
            if room[to] <= 0.0 or narrowest[to] >= 0:
                continue
            least = narrowest[cell]
            narrowest[to] = to if room[to] < room[least] else least
            steps[to] = steps[cell] + 1
            count = push(keys, items, count, _STEP * steps[to] - float(room[narrowest[to]]), to)
    return -1
