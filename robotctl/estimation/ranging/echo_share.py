"""How much of a scan a map explains at a pose: a check for poses without a reference."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from robotctl.model.geometry.points import moved
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import OCCUPIED_FROM, GridMap
from robotctl.model.sensors.range_scan import RangeScan

NEAR_M: Final = 0.2
"""Maximum distance of an echo from its obstacle on the map [m]."""


class EchoShare:
    """Which share of a scan's echoes has an obstacle of a map where it ends.

    Parameters
    ----------
    grid
        The map.
    """

    def __init__(self, grid: GridMap) -> None:
        self._grid = grid
        reach = math.ceil(NEAR_M / grid.resolution_m)
        steps = np.arange(-reach, reach + 1)
        off = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        self._off = off[np.hypot(*off.T) * grid.resolution_m <= NEAR_M]

    def __call__(self, scan: RangeScan, pose: SE2) -> float | None:
        """Return the share at a pose of `base` in `world`, 0 to 1; None if there is no echo.

        Echoes off the map count as not explained.
        """
        points = scan.points_base()
        if len(points) == 0:
            return None
        near = self._grid.cell_of(moved(pose, points))[:, None] + self._off
        cells = self._grid.cells
        inside = np.all((near >= 0) & (near < cells.shape), axis=2)
        near = np.where(inside[:, :, None], near, 0)
        hit = inside & (cells[near[:, :, 0], near[:, :, 1]] >= OCCUPIED_FROM)
        return float(np.mean(hit.any(axis=1)))
