"""Walls drawn into a grid, for what needs cells: likelihood field, casting of rays, free places."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import FREE, OCCUPIED, UNKNOWN, GridMap
from robotctl.model.wall_map import WallMap

_BORDER = 1
"""Cells around the walls, so that a wall on the bound is closed."""


def grid_of_walls(walls: WallMap, resolution_m: float = 0.05) -> GridMap:
    """Return walls as a grid: occupied where one passes, free inside, unknown outside.

    Inside is what cannot be reached from the border; where walls enclose nothing, all is free.

    Parameters
    ----------
    walls
        The map.
    resolution_m
        Side of a cell [m], > 0.

    Raises
    ------
    ValueError
        If `resolution_m` is out of its range.
    """
    if not 0.0 < resolution_m < math.inf:
        raise ValueError(f"resolution_m must be finite and > 0, found {resolution_m}")
    from scipy import ndimage  # type: ignore[import-untyped] # noqa: PLC0415 - it takes 0.2 s

    occupied = _drawn(walls, resolution_m)
    regions, _ = ndimage.label(~occupied)
    outside = np.isin(
        regions, np.unique(np.concatenate([regions[0], regions[-1], regions[:, 0], regions[:, -1]]))
    )
    free = ~outside & ~occupied
    if not free.any():
        free = ~occupied
    cells = np.full(occupied.shape, UNKNOWN, np.int8)
    cells[free] = FREE
    cells[occupied] = OCCUPIED
    min_x, min_y, _, _ = walls.bounds
    origin = SE2(min_x - _BORDER * resolution_m, min_y - _BORDER * resolution_m, 0.0)
    return GridMap(cells, resolution_m, origin)


def _drawn(walls: WallMap, resolution_m: float) -> NDArray[np.bool_]:
    """Return which cells a wall passes, (rows, columns).

    A wall is drawn by points a quarter of a cell apart: it may miss the corner of a cell, but
    leaves no gap.
    """
    min_x, min_y, max_x, max_y = walls.bounds
    shape = (
        math.floor((max_y - min_y) / resolution_m) + 1 + 2 * _BORDER,
        math.floor((max_x - min_x) / resolution_m) + 1 + 2 * _BORDER,
    )
    occupied = np.zeros(shape, np.bool_)
    for ax, ay, bx, by in walls.segments:
        count = math.ceil(4.0 * math.hypot(bx - ax, by - ay) / resolution_m) + 1
        columns = np.floor((np.linspace(ax, bx, count) - min_x) / resolution_m).astype(np.int64)
        rows = np.floor((np.linspace(ay, by, count) - min_y) / resolution_m).astype(np.int64)
        occupied[rows + _BORDER, columns + _BORDER] = True
    return occupied
