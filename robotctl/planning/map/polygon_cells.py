"""The cells of a map that a polygon touches."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robotctl.model.fence import Point
from robotctl.model.grid_map import GridMap

_TOUCH: Final = 1e-6
"""Gap that still counts as contact [cells]; rounding must not lose a side between two cells."""


class PolygonCells(NamedTuple):
    """Cells of a map by their place in a polygon, (rows, columns) each."""

    inside: NDArray[np.bool_]
    """The centre is inside: a line from it crosses the sides an odd number of times."""
    on_sides: NDArray[np.bool_]
    """A side passes through the cell or along its edge."""

    @property
    def touched(self) -> NDArray[np.bool_]:
        """The polygon and the square of the cell have a point in common.

        That is exact: a square that no side touches lies as a whole where its centre does.
        """
        return self.inside | self.on_sides


def polygon_cells(corners: Sequence[Point], grid: GridMap) -> PolygonCells:
    """Return where the cells of a map lie in a polygon, which may cross or touch itself.

    Parameters
    ----------
    corners
        Three or more, in either order, in `world` [m]; they may lie beyond the map.
    grid
        The map.
    """
    rows, columns = grid.shape
    # Changes along each row, summed up at the end.
    crossings, covers = np.zeros((2, rows, columns + 1), np.int32)
    points = in_cells(corners, grid)
    for a, b in zip(points.tolist(), np.roll(points, -1, axis=0).tolist(), strict=True):
        crossed, beyond = _crossing(a, b, (rows, columns))
        np.add.at(crossings, (crossed, beyond), 1)
        covered, first, last = _cover(a, b, (rows, columns))
        np.add.at(covers, (covered, first), 1)
        np.add.at(covers, (covered, last + 1), -1)
    inside = np.cumsum(crossings, axis=1)[:, :columns] % 2 == 1
    return PolygonCells(inside, np.cumsum(covers, axis=1)[:, :columns] > 0)


def in_cells(points: Sequence[Point], grid: GridMap) -> NDArray[np.float64]:
    """Return points of `world` [m] in the frame of a map, (n, 2): x along its columns [cells]."""
    c, s = math.cos(grid.origin.theta_rad), math.sin(grid.origin.theta_rad)
    away = (np.array(points) - (grid.origin.x_m, grid.origin.y_m)) / grid.resolution_m
    return np.stack([c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0]], axis=1)


def _crossing(
    a: list[float], b: list[float], shape: tuple[int, int]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return rows whose centre line a side crosses, and the first column whose centre is beyond."""
    (ax, ay), (bx, by) = a, b
    rows = np.arange(
        max(math.ceil(min(ay, by) - 0.5), 0), min(math.ceil(max(ay, by) - 0.5), shape[0])
    )
    if not len(rows):
        return rows, rows
    x = ax + (rows + 0.5 - ay) / (by - ay) * (bx - ax)
    return rows, np.clip(np.floor(x + 0.5), 0, shape[1]).astype(np.int64)


def _cover(
    a: list[float], b: list[float], shape: tuple[int, int]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return the rows that a side touches, and its first and last column in each."""
    (ax, ay), (bx, by) = a, b
    low, high = math.floor(min(ay, by) - _TOUCH), math.floor(max(ay, by) + _TOUCH)
    rows = np.arange(max(low, 0), min(high, shape[0] - 1) + 1)
    shares = np.tile([[0.0], [1.0]], len(rows))
    if ay != by:  # the part of the side between the lower and the upper edge of each row
        with np.errstate(over="ignore"):  # of a side that is as good as level
            shares = np.clip((np.stack([rows - _TOUCH, rows + 1 + _TOUCH]) - ay) / (by - ay), 0, 1)
    x = ax + shares * (bx - ax)
    first, last = np.floor(x.min(axis=0) - _TOUCH), np.floor(x.max(axis=0) + _TOUCH)
    on_map = (last >= 0) & (first < shape[1])
    first, last = (
        np.clip(each[on_map], 0, shape[1] - 1).astype(np.int64) for each in (first, last)
    )
    return rows[on_map], first, last
