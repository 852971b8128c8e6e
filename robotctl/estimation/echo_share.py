"""How much of a scan a map explains at a pose: what can be said of a pose that has no reference."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy import ndimage  # type: ignore[import-untyped]

from robotctl.model.grid_map import GridMap
from robotctl.model.range_scan import RangeScan
from robotctl.model.se2 import SE2

NEAR_M: Final = 0.2
"""An echo so near to an obstacle of the map is from it [m]."""


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
        off = np.arange(-reach, reach + 1) * grid.resolution_m
        disc = np.hypot(off[:, None], off) <= NEAR_M
        self._near = ndimage.binary_dilation(grid.occupied(), disc)

    def __call__(self, scan: RangeScan, pose: SE2) -> float | None:
        """Return the share at a pose of `base` in `world`, 0 to 1; None where there is no echo.

        What ends off the map counts as not explained.
        """
        points = scan.points_base()
        if len(points) == 0:
            return None
        c, s = math.cos(pose.theta_rad), math.sin(pose.theta_rad)
        world = points @ np.array([[c, s], [-s, c]]) + (pose.x_m, pose.y_m)
        rows, columns = self._grid.cell_of(world).T
        height, width = self._near.shape
        inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
        hits = np.count_nonzero(self._near[rows[inside], columns[inside]])
        return float(hits) / len(points)
