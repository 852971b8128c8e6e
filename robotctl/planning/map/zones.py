"""The cells of zones that a robot keeps out of, or passes slowly."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robotctl.model.fence import Fence
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import FREE, GridMap
from robotctl.planning.map.doors import NO_DOORS, Doors
from robotctl.planning.map.fence import beyond_fence
from robotctl.planning.map.mask import SPEEDS, Mask
from robotctl.planning.map.polygon_cells import polygon_cells
from robotctl.planning.map.zone import Zone

_DEAREST: Final = 10.0
"""Maximum price of a cell: the planner has few classes of cost."""


class Closed(NamedTuple):
    """Bounds of where the robot may be, in addition to the map."""

    zones: tuple[Zone, ...] = ()
    fence: Fence = Fence()
    masks: tuple[Mask, ...] = ()
    doors: Doors = NO_DOORS
    """Doors, which close nothing but cost extra."""

    def cells(self, grid: GridMap) -> NDArray[np.bool_]:
        """Return which cells of a map the robot has to keep out of, (rows, columns)."""
        closed = beyond_fence(self.fence, grid)
        for zone in self.zones:
            if zone.speed_m_s == 0.0:
                closed |= cells_of(zone, grid)
        for mask in self.masks:
            closed |= mask.closed(grid)
        return closed

    def what_closes(self, grid: GridMap, cell: tuple[int, int]) -> str:
        """Return the name of what closes a cell, a row and a column; empty: nothing does."""
        side_m = grid.resolution_m
        corner = grid.origin @ SE2(cell[1] * side_m, cell[0] * side_m, 0.0)
        alone = GridMap(np.full((1, 1), FREE, np.int8), side_m, corner)
        for zone in self.zones:
            if zone.speed_m_s == 0.0 and cells_of(zone, alone)[0, 0]:
                return f"the keep-out zone {zone.name}"
        for mask in self.masks:
            if mask.closed(alone)[0, 0]:
                return f"the keep-out mask {mask.config.file}"
        return "the fence" if beyond_fence(self.fence, alone)[0, 0] else ""


def cells_of(zone: Zone, grid: GridMap) -> NDArray[np.bool_]:
    """Return which cells of a map a zone touches, (rows, columns)."""
    return polygon_cells(zone.corners, grid).touched


def path_prices(
    grid: GridMap,
    closed: Closed,
    limits_m_s: NDArray[np.float32] | None,
    full_speed_m_s: float,
) -> NDArray[np.float32] | None:
    """Return how many times longer a path counts in each cell; None: nowhere more than once.

    Where the robot is slow, as much longer as it takes; where a mask or a door says so, times that.
    """
    of_masks = (mask.prices(grid) for mask in closed.masks)
    prices = [each for each in (*of_masks, closed.doors.prices(grid)) if each is not None]
    if limits_m_s is not None:
        prices.append(np.maximum(full_speed_m_s / limits_m_s, 1.0))
    if not prices:
        return None
    longer: NDArray[np.float32] = np.clip(np.prod(prices, axis=0), 1.0, _DEAREST)
    return longer.astype(np.float32)


def speed_limits(
    grid: GridMap, closed: Closed, full_speed_m_s: float
) -> NDArray[np.float32] | None:
    """Return the speed limit of each cell [m/s], inf where there is none; None: nowhere."""
    slow = [zone for zone in closed.zones if zone.speed_m_s > 0.0]
    masks = [mask for mask in closed.masks if mask.config.kind in SPEEDS]
    if not slow and not masks:
        return None
    limits = np.full(grid.shape, np.inf, np.float32)
    for zone in slow:
        inside = cells_of(zone, grid)
        limits[inside] = np.minimum(limits[inside], zone.speed_m_s)
    for mask in masks:
        np.minimum(limits, mask.limits(grid, full_speed_m_s), out=limits)
    return limits
