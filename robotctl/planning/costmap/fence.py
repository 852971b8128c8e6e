"""The cells of a map that are beyond the fence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.fence import Fence, Point
from robotctl.model.grid_map import OCCUPIED, GridMap

MARGIN_M: Final = 0.1
"""Planning keeps so far from the fence [m]: nearer, a robot that is a little off its path would be
held back again and again."""


def close_fence(cells: NDArray[np.int8], grid: GridMap, fence: Fence) -> None:
    """Mark the cells of a map, (rows, columns), that are beyond the fence or near it."""
    for polygon in fence.polygons:
        inside = cells_inside(polygon.corners, grid)
        cells[inside != polygon.keeps_in] = OCCUPIED
        _close_sides(cells, grid, polygon.corners)
    if not fence.circles:
        return
    every = np.indices(grid.shape).reshape(2, -1).T
    x_m, y_m = grid.centre_of(every).T
    for circle in fence.circles:
        away_m = np.hypot(x_m - circle.x_m, y_m - circle.y_m).reshape(grid.shape)
        if circle.keeps_in:
            cells[away_m > circle.radius_m - MARGIN_M] = OCCUPIED
        else:
            cells[away_m < circle.radius_m + MARGIN_M] = OCCUPIED


def cells_inside(polygon: Sequence[Point], grid: GridMap) -> NDArray[np.bool_]:
    """Return which cells of a map have their centre in a polygon, (rows, columns).

    A point is inside if a line from it crosses the sides an odd number of times.
    """
    inside = np.zeros(grid.shape, np.bool_)
    corners = _in_cells(polygon, grid)
    for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        rows = np.arange(
            max(math.ceil(min(ay, by) - 0.5), 0),
            min(math.ceil(max(ay, by) - 0.5), grid.shape[0]),
        )
        if len(rows):
            crossing = ax + (rows + 0.5 - ay) / (by - ay) * (bx - ax)
            inside[rows] ^= np.arange(grid.shape[1]) + 0.5 > crossing[:, np.newaxis]
    return inside


def _in_cells(points: Sequence[Point], grid: GridMap) -> NDArray[np.float64]:
    """Return points of `world` in cells of the map, (n, 2): x along the columns."""
    c, s = math.cos(grid.origin.theta_rad), math.sin(grid.origin.theta_rad)
    away = (np.array(points) - (grid.origin.x_m, grid.origin.y_m)) / grid.resolution_m
    return np.stack([c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0]], axis=1)


def _close_sides(cells: NDArray[np.int8], grid: GridMap, corners: Sequence[Point]) -> None:
    """Mark the cells whose centre is near a side of a polygon."""
    margin = MARGIN_M / grid.resolution_m
    points = _in_cells(corners, grid)
    rows, columns = grid.shape
    for a, b in zip(points, np.roll(points, -1, axis=0), strict=True):
        low, high = (
            np.clip(end, 0, (columns, rows)).astype(int)
            for end in (np.floor(np.minimum(a, b) - margin), np.ceil(np.maximum(a, b) + margin))
        )
        y, x = np.mgrid[low[1] : high[1], low[0] : high[0]] + 0.5
        way = b - a
        along = (x - a[0]) * way[0] + (y - a[1]) * way[1]
        along = np.clip(along / max(float(way @ way), 1e-12), 0.0, 1.0)
        away = np.hypot(x - a[0] - along * way[0], y - a[1] - along * way[1])
        cells[low[1] : high[1], low[0] : high[0]][away < margin] = OCCUPIED
