"""The cells of zones that a robot keeps out of, or passes slowly."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from robotctl.model.grid_map import GridMap
from robotctl.planning.costmap.zone import Zone


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
