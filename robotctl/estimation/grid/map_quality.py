"""Precision and recall of an occupancy grid's occupied cells against known walls.

The walls are drawn into the grid's own cells: a cell is a wall cell if a wall passes it. A cell of
one kind counts as found if there is one of the other kind at most one cell away, diagonals
included: a wall on the line between two cells is in one of them by chance, and the map's error of
one side of a cell is what its resolution allows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage  # type: ignore[import-untyped]

from robotctl.model.grid_map import GridMap
from robotctl.model.wall_map import WallMap

_AWAY = np.ones((3, 3), np.bool_)


@dataclass(frozen=True, slots=True)
class CellQuality:
    """Agreement of occupied cells with wall cells.

    Parameters
    ----------
    precision
        Share of the occupied cells that have a wall within one cell, 0 to 1; 0 without any.
    recall
        Share of all wall cells, also of those outside of the map, that have an occupied cell
        within one cell, 0 to 1.
    occupied, walls
        Number of occupied cells, and of wall cells.
    """

    precision: float
    recall: float
    occupied: int
    walls: int


def map_quality(grid: GridMap, truth: WallMap) -> CellQuality:
    """Compare a map with the walls that are there.

    Walls that nobody could see count too, so the recall of a map of one room of a flat is low.
    """
    occupied = np.argwhere(grid.occupied())
    walls = wall_cells(grid, truth)
    together = np.concatenate([occupied, walls])
    first = together.min(axis=0) - 1
    shape = together.max(axis=0) - first + 2
    shows, is_wall = np.zeros(shape, np.bool_), np.zeros(shape, np.bool_)
    shows[tuple((occupied - first).T)] = True
    is_wall[tuple((walls - first).T)] = True
    right = shows & ndimage.binary_dilation(is_wall, _AWAY)
    found = is_wall & ndimage.binary_dilation(shows, _AWAY)
    return CellQuality(
        precision=float(right.sum() / max(1, len(occupied))),
        recall=float(found.sum() / len(walls)),
        occupied=len(occupied),
        walls=len(walls),
    )


def wall_cells(grid: GridMap, truth: WallMap) -> NDArray[np.int64]:
    """Return (row, column) of each cell that a wall passes, (n, 2), also outside of the map."""
    c, s = math.cos(grid.origin.theta_rad), math.sin(grid.origin.theta_rad)
    points = truth.segments.reshape(-1, 2) - (grid.origin.x_m, grid.origin.y_m)
    along = points @ np.array([[c, -s], [s, c]]) / grid.resolution_m
    cells = [_passed(begin, end) for begin, end in along.reshape(-1, 2, 2)]
    return np.unique(np.concatenate(cells), axis=0)


def _passed(begin: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return (row, column) of the cells between two points (x, y) [cells], exactly.

    Between two neighbouring crossings of grid lines a line is in one cell, that of their middle.
    """
    shares = [np.array([0.0, 1.0])]
    for axis in range(2):
        low, high = sorted((float(begin[axis]), float(end[axis])))
        lines = np.arange(math.ceil(low), math.floor(high) + 1)
        if high > low:
            shares.append((lines - begin[axis]) / (end[axis] - begin[axis]))
    share = np.sort(np.concatenate(shares))
    middle = 0.5 * (share[1:] + share[:-1])[:, None]
    points = begin + middle * (end - begin)
    cells: NDArray[np.int64] = np.floor(points[:, ::-1]).astype(np.int64)
    return cells
