"""The cells of zones that a robot keeps out of, or passes slowly."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.grid_map import OCCUPIED, GridMap
from robotctl.planning.costmap.zone import Zone

_SLOWEST: Final = 10.0
"""A path through a slow zone counts at most so many times longer: the classes of cost are few."""


def cells_of(zone: Zone, grid: GridMap) -> NDArray[np.bool_]:
    """Return which cells of a map have their centre in a zone, (rows, columns).

    A point is inside if a line from it crosses the sides an odd number of times.
    """
    inside = np.zeros(grid.shape, np.bool_)
    c, s = math.cos(grid.origin.theta_rad), math.sin(grid.origin.theta_rad)
    away = (np.array(zone.corners) - (grid.origin.x_m, grid.origin.y_m)) / grid.resolution_m
    corners = np.stack([c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0]], axis=1)
    for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        rows = np.arange(
            max(math.ceil(min(ay, by) - 0.5), 0),
            min(math.ceil(max(ay, by) - 0.5), grid.shape[0]),
        )
        if len(rows):
            crossing = ax + (rows + 0.5 - ay) / (by - ay) * (bx - ax)
            inside[rows] ^= np.arange(grid.shape[1]) + 0.5 > crossing[:, np.newaxis]
    return inside


def close_zones(cells: NDArray[np.int8], grid: GridMap, zones: Sequence[Zone]) -> None:
    """Mark the cells of a map, (rows, columns), that lie in keep-out zones as occupied."""
    for zone in zones:
        if zone.speed_m_s == 0.0:
            cells[cells_of(zone, grid)] = OCCUPIED


def slowness(limits_m_s: NDArray[np.float32], full_speed_m_s: float) -> NDArray[np.float32]:
    """Return how many times longer a path counts in each cell: as much longer as it takes."""
    longer: NDArray[np.float32] = np.clip(full_speed_m_s / limits_m_s, 1.0, _SLOWEST)
    return longer.astype(np.float32)


def speed_limits(grid: GridMap, zones: Sequence[Zone]) -> NDArray[np.float32] | None:
    """Return the speed limit of each cell [m/s], inf where there is none; None: nowhere."""
    slow = [zone for zone in zones if zone.speed_m_s > 0.0]
    if not slow:
        return None
    limits = np.full(grid.shape, np.inf, np.float32)
    for zone in slow:
        inside = cells_of(zone, grid)
        limits[inside] = np.minimum(limits[inside], zone.speed_m_s)
    return limits
