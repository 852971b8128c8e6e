"""The map of an occupancy grid, row by row: the map of a campus need not fit into memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import UNKNOWN, GridMap

Parts: TypeAlias = Callable[
    [NDArray[np.int64], NDArray[np.int64]],
    Iterator[tuple[tuple[slice, slice], NDArray[np.int8]]],
]


class MapRows:
    """The map of a grid, whose rows are computed when they are read; see `model.CellRows`.

    Parameters
    ----------
    parts
        Known parts of a rectangle; see `OccupancyGrid.parts`.
    first, end
        Row and column of the first cell of the map, and behind its last.
    value
        (256,) which value a cell with so many steps has; negative steps count from the end.
    resolution_m
        Length of a cell's side [m].
    """

    def __init__(
        self,
        parts: Parts,
        first: NDArray[np.int64],
        end: NDArray[np.int64],
        value: NDArray[np.int8],
        resolution_m: float,
    ) -> None:
        self._parts, self._first, self._value = parts, first, value
        self.shape = (int(end[0] - first[0]), int(end[1] - first[1]))
        self.resolution_m = resolution_m
        # Without the last digits of a product: -50.9, not -50.900000000000006.
        x_m, y_m = (round(float(at) * resolution_m, 9) for at in (first[1], first[0]))
        self.origin = SE2(x_m, y_m)

    def rows(self, begin: int, end: int) -> NDArray[np.int8]:
        """Return the rows from `begin` to before `end`, (end - begin, columns)."""
        result = np.full((end - begin, self.shape[1]), UNKNOWN, np.int8)
        corner = self._first + np.array([begin, 0])
        for part, cells in self._parts(corner, corner + np.array(result.shape)):
            result[part] = self._value.take(cells.view(np.uint8))
        return result

    def whole(self) -> GridMap:
        """Return the whole map."""
        return GridMap(self.rows(0, self.shape[0]), self.resolution_m, self.origin)


def inner(counts: NDArray[np.int64], strays: float) -> tuple[int, int]:
    """Return the range of counts, first and end, that leaves out at most `strays` at each side."""
    from_low, from_high = np.cumsum(counts), np.cumsum(counts[::-1])
    low = int(np.searchsorted(from_low, strays, side="right"))
    high = int(np.searchsorted(from_high, strays, side="right"))
    return low, len(counts) - high
