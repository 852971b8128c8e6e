"""An occupancy grid as a value: free, occupied and unknown cells of the world."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.se2 import SE2

FREE: Final = 0
OCCUPIED: Final = 100
UNKNOWN: Final = -1
OCCUPIED_FROM: Final = 50
"""Occupancy from which a cell is an obstacle [%]: more likely than not."""
STRIP: Final = 1024
"""Rows of a large map that are processed at once."""


class CellRows(Protocol):
    """A map whose rows are computed on demand, so that a large one need not fit into memory.

    `GridMap` describes its attributes.
    """

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns."""
        ...

    @property
    def resolution_m(self) -> float:
        """Length of a cell's side [m]."""
        ...

    @property
    def origin(self) -> SE2:
        """`T_world_map`."""
        ...

    def rows(self, begin: int, end: int) -> NDArray[np.int8]:
        """Return the rows `begin` to `end` - 1, (end - begin, columns)."""
        ...


def count_values(grid: CellRows) -> NDArray[np.int64]:
    """Return the number of cells of each value, (256,); `UNKNOWN` is the last."""
    values = np.zeros(256, np.int64)
    for row in range(0, grid.shape[0], STRIP):
        strip = grid.rows(row, min(row + STRIP, grid.shape[0])).view(np.uint8)
        values += sum(np.bincount(each, minlength=256) for each in strip)
    return values


@dataclass(frozen=True, slots=True, eq=False)
class GridMap:
    """A map of square cells, with the values of ROS (`nav_msgs/OccupancyGrid`).

    Parameters
    ----------
    cells
        (rows, columns) int8: the probability of being occupied in percent, 0 to 100, or
        `UNKNOWN`. Row 0 lies at the lower edge; rows grow with y, columns with x of the map.
    resolution_m
        Length of a cell's side [m], > 0.
    origin
        `T_world_map`: the outer corner of cell (0, 0), and the direction of its row.

    Raises
    ------
    ValueError
        If the cells are not (rows, columns) int8 with both > 0, or a number is out of its range.
    """

    cells: NDArray[np.int8]
    resolution_m: float
    origin: SE2 = field(default_factory=SE2)

    def __post_init__(self) -> None:
        if self.cells.ndim != 2 or 0 in self.cells.shape or self.cells.dtype != np.int8:
            raise ValueError(
                f"cells must be (rows, columns) int8, found {self.cells.shape} {self.cells.dtype}"
            )
        if not 0.0 < self.resolution_m < math.inf:
            raise ValueError(f"resolution_m must be finite and > 0, found {self.resolution_m}")
        if not math.isfinite(self.origin.x_m + self.origin.y_m + self.origin.theta_rad):
            raise ValueError("origin must be finite")

    def cell_of(self, points_world: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return (row, column) of each point (n, 2) [m], (n, 2); may be outside the map."""
        c, s = math.cos(self.origin.theta_rad), math.sin(self.origin.theta_rad)
        x = points_world[:, 0] - self.origin.x_m
        y = points_world[:, 1] - self.origin.y_m
        along = np.stack([-s * x + c * y, c * x + s * y], axis=1)
        return np.floor(along / self.resolution_m).astype(np.int64)

    def centre_of(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the centre in world of each (row, column) of (n, 2), (n, 2) [m]."""
        c, s = math.cos(self.origin.theta_rad), math.sin(self.origin.theta_rad)
        x = (cells[:, 1] + 0.5) * self.resolution_m
        y = (cells[:, 0] + 0.5) * self.resolution_m
        return np.stack([self.origin.x_m + c * x - s * y, self.origin.y_m + s * x + c * y], axis=1)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns."""
        return self.cells.shape[0], self.cells.shape[1]

    def rows(self, begin: int, end: int) -> NDArray[np.int8]:
        """Return the rows `begin` to `end` - 1."""
        return self.cells[begin:end]

    def occupied(self, threshold: int = OCCUPIED_FROM) -> NDArray[np.bool_]:
        """Return which cells are occupied with at least `threshold` percent, (rows, columns)."""
        return self.cells >= threshold

    def free(self, threshold: int = OCCUPIED_FROM) -> NDArray[np.bool_]:
        """Return which cells are known and occupied with less than `threshold` percent."""
        return (self.cells >= 0) & (self.cells < threshold)
