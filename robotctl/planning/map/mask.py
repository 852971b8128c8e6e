"""Masks: pictures of where a robot keeps out, would rather not be, drives slowly, or reports."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.points import moved
from robotctl.model.grid_map import OCCUPIED, UNKNOWN, GridMap
from robotctl.planning.map.mask_config import MaskConfig

_INSIDE: Final = 0.5 - 1e-6
"""Distance from the centre of a cell to just inside its edge [cells]."""
_NO_LIMIT: Final = 0
_INSIDE_FROM: Final = 0.5
"""Threshold of `base + multiplier * value` for the area of a binary mask, as in nav2."""
SPEEDS: Final = ("speed_percent", "speed_m_s")
"""Kinds that limit the speed."""
_DOUBLE: Final = 25.0
"""Value of a keep-out mask at which each metre counts as two, as for nav2's NavFn."""


@dataclass(frozen=True, slots=True, eq=False)
class Mask:
    """A mask in `world`.

    Parameters
    ----------
    config
        What its values mean.
    grid
        The values.

    Raises
    ------
    ValueError
        If a value of it limits the speed to none above 0, or to more than 100 per cent.
    """

    config: MaskConfig
    grid: GridMap

    def __post_init__(self) -> None:
        """Check what the values mean."""
        if self.config.kind not in SPEEDS:
            return
        used = np.unique(self.grid.cells)
        most = 100.0 if self.config.kind == "speed_percent" else math.inf
        for value in used[used > _NO_LIMIT].tolist():
            speed = self._means(value)
            if not 0.0 < speed <= most:
                raise ValueError(
                    f"{self.config.file}: a value of {value} means {speed:g} "
                    f"({self.config.kind} = {self.config.base:g} + {self.config.multiplier:g} * "
                    f"value); above 0{', at most 100,' if most < math.inf else ''} is allowed"
                )

    def _means(self, value: int) -> float:
        return self.config.base + self.config.multiplier * value

    def has(self, x_m: float, y_m: float) -> bool:
        """Return whether a place is in the area of a binary mask; a mask of another kind has none.

        What it does not know, or is beyond it, is outside.
        """
        if self.config.kind != "binary":
            return False
        row, column = self.grid.cell_of(np.array([[x_m, y_m]]))[0].tolist()
        value = int(self._at(np.array([[column, row]]))[0])
        return value != UNKNOWN and self._means(value) > _INSIDE_FROM

    def closed(self, grid: GridMap) -> NDArray[np.bool_]:
        """Return which cells of a map the robot keeps out of: those that the mask touches."""
        closed = np.zeros(grid.shape, np.bool_)
        if self.config.kind == "keep_out":
            for values in self._seen_from(grid):
                closed |= values >= OCCUPIED
        return closed

    def prices(self, grid: GridMap) -> NDArray[np.float32] | None:
        """Return how many times longer a path counts in each cell, not to be crossed if possible.

        None: nowhere more than once.
        """
        values = self.grid.cells
        if self.config.kind != "keep_out" or not ((values > 0) & (values < OCCUPIED)).any():
            return None
        most = np.zeros(grid.shape, np.int8)
        for seen in self._seen_from(grid):
            np.maximum(most, seen, out=most)
        return 1.0 + most.astype(np.float32) / np.float32(_DOUBLE)

    def limits(self, grid: GridMap, full_speed_m_s: float) -> NDArray[np.float32]:
        """Return the lowest speed limit in each cell of a map [m/s]; inf: there is none.

        Parameters
        ----------
        grid
            The map.
        full_speed_m_s
            Fastest speed of the robot [m/s].
        """
        limits = np.full(grid.shape, np.inf, np.float32)
        if self.config.kind not in SPEEDS:
            return limits
        unit = 0.01 * full_speed_m_s if self.config.kind == "speed_percent" else 1.0
        speeds = [unit * self._means(value) for value in range(_NO_LIMIT + 1, OCCUPIED + 1)]
        table = np.array([np.inf, *speeds], np.float32)
        for values in self._seen_from(grid):
            np.minimum(limits, table[np.maximum(values, _NO_LIMIT)], out=limits)
        return limits

    def _seen_from(self, grid: GridMap) -> Iterator[NDArray[np.int8]]:
        """Yield values of the mask, one in each cell of a map, (rows, columns).

        They are as close as the cells of the finer one, so that none of the mask is missed; beyond
        it, or where it is unknown, they are `UNKNOWN`.
        """
        side_m, (rows, columns) = grid.resolution_m, grid.shape
        count = 2 * math.ceil(side_m / self.grid.resolution_m) + 1
        column, row = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
        centres = np.stack([column.ravel(), row.ravel()], 1)
        T_mask_map = self.grid.origin.inverse() @ grid.origin
        for y in np.linspace(-_INSIDE, _INSIDE, count):
            for x in np.linspace(-_INSIDE, _INSIDE, count):
                points = moved(T_mask_map, (centres + np.array((x, y))) * side_m)
                cells = np.floor(points / self.grid.resolution_m).astype(np.int64)
                yield self._at(cells).reshape(rows, columns)

    def _at(self, cells: NDArray[np.int64]) -> NDArray[np.int8]:
        """Return the values of columns and rows, (n, 2)."""
        height, width = self.grid.shape
        column, row = cells.T
        within = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        values = np.full(len(cells), UNKNOWN, np.int8)
        values[within] = self.grid.cells[row[within], column[within]]
        return values
