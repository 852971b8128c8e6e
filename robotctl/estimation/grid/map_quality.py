"""Precision and recall of an occupancy grid's occupied cells against known walls.

The walls are drawn into the grid's own cells: a cell is a wall cell if a wall passes it. A cell of
one kind counts as found if there is one of the other kind at most one cell away, diagonals
included: a wall on the line between two cells is in one of them by chance, and the map's error of
one side of a cell is what its resolution allows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage  # type: ignore[import-untyped]
from scipy.spatial import KDTree  # type: ignore[import-untyped]

from robotctl.model.geometry.points import align, moved
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.model.wall_map import WallMap

_AWAY = np.ones((3, 3), np.bool_)
_FAR_M: Final = 0.5
_ROUNDS: Final = 40
_FINE: Final = 0.2
"""Spacing of the points of a wall, as a share of a cell, for laying a map over it."""


@dataclass(frozen=True, slots=True)
class CellQuality:
    """Agreement of occupied cells with wall cells.

    Parameters
    ----------
    precision
        Share of the occupied cells that have a wall within one cell, 0 to 1; 0 without any.
    recall
        Share of the cells of walls that can be seen, also of those outside of the map, that have an
        occupied cell within one cell, 0 to 1.
    occupied, walls
        Number of occupied cells, and of cells of walls that can be seen.
    """

    precision: float
    recall: float
    occupied: int
    walls: int


def map_quality(grid: GridMap, truth: WallMap, visible: WallMap | None = None) -> CellQuality:
    """Compare a map with the walls that are there.

    Parameters
    ----------
    grid
        The map.
    truth
        All walls.
    visible
        Those that can be seen; None: all, also from behind, so that of a map of one room of a flat
        the recall is low.
    """
    occupied = np.argwhere(grid.occupied())
    walls = wall_cells(grid, truth)
    wanted = walls if visible is None else wall_cells(grid, visible)
    together = np.concatenate([occupied, walls, wanted])
    first = together.min(axis=0) - 1
    shape = together.max(axis=0) - first + 2
    shows, is_wall = np.zeros(shape, np.bool_), np.zeros(shape, np.bool_)
    shows[tuple((occupied - first).T)] = True
    is_wall[tuple((walls - first).T)] = True
    right = shows & ndimage.binary_dilation(is_wall, _AWAY)
    found = ndimage.binary_dilation(shows, _AWAY)[tuple((wanted - first).T)]
    return CellQuality(
        precision=float(right.sum() / max(1, len(occupied))),
        recall=float(found.mean()),
        occupied=len(occupied),
        walls=len(wanted),
    )


def laid_over(grid: GridMap, truth: WallMap) -> GridMap:
    """Return a map moved and turned to where its occupied cells fit the walls best.

    By iterated closest points (Besl and McKay, IEEE PAMI 14(2), 1992), from where it lies: cells
    that are farther than `_FAR_M` from any wall do not pull.
    """
    cells = grid.centre_of(np.argwhere(grid.occupied()))
    fine = replace(grid, resolution_m=_FINE * grid.resolution_m)
    points = fine.centre_of(wall_cells(fine, truth))
    tree = KDTree(points)
    T_there_here = SE2()
    for _ in range(_ROUNDS if len(cells) else 0):
        here = moved(T_there_here, cells)
        away_m, nearest = tree.query(here, distance_upper_bound=_FAR_M)
        near = np.isfinite(away_m)
        if np.count_nonzero(near) < 2:
            break
        T_there_here = align(here[near], points[nearest[near]]) @ T_there_here
    return replace(grid, origin=T_there_here @ grid.origin)


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
