"""The cells of zones that a robot keeps out of, or passes slowly."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robotctl.model.fence import Fence
from robotctl.model.grid_map import OCCUPIED, GridMap
from robotctl.planning.costmap.fence import cells_inside, close_fence
from robotctl.planning.costmap.zone import Zone

_SLOWEST: Final = 10.0
"""A path through a slow zone counts at most so many times longer: the classes of cost are few."""


class Closed(NamedTuple):
    """What bounds where the robot may be, beside the map."""

    zones: tuple[Zone, ...] = ()
    fence: Fence = Fence()

    def close(self, cells: NDArray[np.int8], grid: GridMap) -> None:
        """Mark the cells of a map, (rows, columns), in which it may not be as occupied."""
        close_zones(cells, grid, self.zones)
        close_fence(cells, grid, self.fence)


def cells_of(zone: Zone, grid: GridMap) -> NDArray[np.bool_]:
    """Return which cells of a map have their centre in a zone, (rows, columns)."""
    return cells_inside(zone.corners, grid)


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
