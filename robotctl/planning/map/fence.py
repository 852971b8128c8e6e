"""The cells of a map that are beyond the fence."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.fence import Fence, FenceCircle, Point
from robotctl.model.grid_map import GridMap
from robotctl.planning.map.polygon_cells import in_cells, polygon_cells

MARGIN_M: Final = 0.1
"""Planning keeps so far from the fence [m]: nearer, a robot that is a little off its path would be
held back again and again."""


def beyond_fence(fence: Fence, grid: GridMap) -> NDArray[np.bool_]:
    """Return which cells of a map are not wholly within the fence, or near it, (rows, columns).

    Near is a centre less than `MARGIN_M` away.
    """
    beyond = np.zeros(grid.shape, np.bool_)
    for polygon in fence.polygons:
        cells = polygon_cells(polygon.corners, grid)
        beyond |= (cells.inside != polygon.keeps_in) | cells.on_sides
        _add_margin(beyond, grid, polygon.corners)
    for circle in fence.circles:
        beyond |= _beyond_circle(circle, grid)
    return beyond


def _beyond_circle(circle: FenceCircle, grid: GridMap) -> NDArray[np.bool_]:
    """Return the same of a circle."""
    x, y = in_cells([(circle.x_m, circle.y_m)], grid)[0].tolist()
    radius, margin = circle.radius_m / grid.resolution_m, MARGIN_M / grid.resolution_m
    along = np.abs(np.arange(grid.shape[1]) + 0.5 - x)
    up = np.abs(np.arange(grid.shape[0]) + 0.5 - y)[:, np.newaxis]
    away: NDArray[np.float64] = np.hypot(along, up)
    if circle.keeps_in:
        farthest: NDArray[np.float64] = np.hypot(along + 0.5, up + 0.5)
        return np.maximum(away + margin, farthest) > radius
    nearest: NDArray[np.float64] = np.hypot(np.maximum(along - 0.5, 0.0), np.maximum(up - 0.5, 0.0))
    return np.minimum(away - margin, nearest) <= radius


def _add_margin(beyond: NDArray[np.bool_], grid: GridMap, corners: Sequence[Point]) -> None:
    """Mark the cells whose centre is near a side of a polygon."""
    margin = MARGIN_M / grid.resolution_m
    points = in_cells(corners, grid)
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
        beyond[low[1] : high[1], low[0] : high[0]] |= away < margin
