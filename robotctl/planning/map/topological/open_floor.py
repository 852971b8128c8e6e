"""Open floor of halls: divided until each part is seen from its middle."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage  # type: ignore[import-untyped]

from robotctl.planning.map.topological.appearance import REACH_M
from robotctl.planning.map.topological.regions import around

_SHARE: Final = 0.9
"""Least share of a region that is seen from its middle, within a lidar's reach."""
_LARGE_M2: Final = 64.0
"""Area from which on a region is divided [m2]."""
_GRID_M: Final = 0.2
"""Side of the cells that are looked at [m]."""

Mask = NDArray[np.bool_]


def middle_depth_m(
    inside: Mask, depth_m: NDArray[np.float64], radius_m: float, side_m: float
) -> NDArray[np.float64]:
    """Return how far each cell is from walls and from the rest of the floor [m], 0 outside.

    Regions begin `radius_m` off the walls.
    """
    depths = np.zeros(inside.shape)
    window = around(inside, margin=0)
    inner = ndimage.distance_transform_edt(np.pad(inside[window], 1))[1:-1, 1:-1]
    limit_m = (inner + 0.5) * side_m + radius_m
    depths[window] = np.where(inside[window], np.minimum(depth_m[window], limit_m), 0.0)
    return depths


def middle_of(depths_m: NDArray[np.float64], side_m: float) -> NDArray[np.int64]:
    """Return row and column of the cell nearest to the mean of the deepest, to a cell's side."""
    spots = np.argwhere(depths_m > depths_m.max() - side_m)
    middle: NDArray[np.int64] = spots[np.argmin(np.sum((spots - spots.mean(axis=0)) ** 2, axis=1))]
    return middle


def with_open_floor(
    labels: NDArray[np.int64],
    depth_m: NDArray[np.float64],
    radius_m: float,
    side_m: float,
) -> NDArray[np.int64]:
    """Halve large regions across their length until each is seen from its middle.

    Parameters
    ----------
    labels
        (rows, columns): region of each cell, -1 for none.
    depth_m
        Distance of each cell from what divides [m].
    radius_m, side_m
        Of the robot, and of a cell [m].
    """
    labels = labels.copy()
    waiting: list[int] = np.unique(labels[labels >= 0]).tolist()
    while waiting:
        inside = labels == (region := waiting.pop())
        if np.count_nonzero(inside) * side_m**2 < _LARGE_M2:
            continue
        middle = middle_of(middle_depth_m(inside, depth_m, radius_m, side_m), side_m)
        if _seen_share(inside, depth_m > 0.0, middle, side_m) >= _SHARE:
            continue
        waiting += _halve(labels, inside, region)
    return labels


def _halve(labels: NDArray[np.int64], inside: Mask, region: int) -> list[int]:
    """Divide a region in two across its longest axis, and return its parts' numbers."""
    cells = np.argwhere(inside)
    off = cells - cells.mean(axis=0)
    along = off @ np.linalg.eigh(off.T @ off)[1][:, 1]
    half = np.zeros(inside.shape, np.int64)
    half[tuple(cells.T)] = np.where(along < 0.0, 1, 2)
    parts = [region]
    for side in (1, 2):
        pieces, count = ndimage.label(half == side, np.ones((3, 3)))
        for piece in range(1, count + 1):
            parts.append(int(labels.max()) + 1)
            labels[pieces == piece] = parts[-1]
    return parts[1:]


def _seen_share(inside: Mask, free: Mask, middle: NDArray[np.int64], side_m: float) -> float:
    """Return the share of a region's cells in a free line with its middle, `REACH_M` at most."""
    step = max(1, round(_GRID_M / side_m))
    rows, columns = np.nonzero(inside[::step, ::step])
    off = np.column_stack([rows, columns]) * step - middle
    away = np.hypot(*off.T)
    off = off[away * side_m <= REACH_M]
    seen = np.ones(len(off), np.bool_)
    for share in np.linspace(0.0, 1.0, math.ceil(REACH_M / side_m)).tolist():
        row, column = np.rint(middle + share * off).astype(np.int64).T
        seen &= free[row, column]
    return float(np.count_nonzero(seen)) / len(away)
