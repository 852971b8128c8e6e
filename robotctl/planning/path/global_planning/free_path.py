"""Ways through the free cells of a map, for a robot that must get back to its mission."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.grid_map import GridMap
from robotctl.planning.map.cost_map import INSCRIBED, CostMapConfig, cost_map
from robotctl.planning.path.global_planning.grid_search import search_cells
from robotctl.planning.path.local.path import Point

MARGIN_M: Final = 0.1
"""Clearance to walls besides the robot's half width [m]."""

_COMFORT_M: Final = 0.4
"""Distance to a wall below which a path costs more [m]."""

_TIGHT: Final = 2.0
"""Cost factor next to the wall."""


class FreePaths:
    """Shortest paths that keep off the walls.

    Unknown cells are not driven through. Nothing is known of things that the map does not show: the
    obstacle guard is still needed. The search is compiled when this is made.

    Parameters
    ----------
    world_map
        The map.
    half_width_m
        Of the robot [m], > 0.
    """

    def __init__(self, world_map: GridMap, half_width_m: float) -> None:
        radius_m = half_width_m + MARGIN_M
        comfort_m = max(_COMFORT_M, radius_m)
        config = CostMapConfig(radius_m, comfort_m, scaling_per_m=5.0, occupied_percent=50)
        self._grid = world_map
        self._costs = cost_map(world_map, config).costs
        self._factors = np.full(256, math.inf)
        self._factors[:INSCRIBED] = 1.0 + _TIGHT * np.arange(INSCRIBED) / (INSCRIBED - 1)
        self._passable = np.argwhere(self._costs < INSCRIBED)
        if len(self._passable):
            cell = self._passable[0].tolist()
            search_cells(self._costs, self._factors, (cell[0], cell[1]), (cell[0], cell[1]))

    def way(self, start: Point, goal: Point) -> list[Point]:
        """Return the corners of a path after `start`, `goal` the last; none if there is no path.

        A robot or goal that is too near to a wall counts as in the nearest cell that is not.
        """
        if not len(self._passable):
            return []
        ends = self._nearest(start), self._nearest(goal)
        cells = search_cells(self._costs, self._factors, *ends).cells
        if not len(cells):
            return []
        corners = self._grid.centre_of(self._straightened(cells))
        return [*((float(x_m), float(y_m)) for x_m, y_m in corners[1:-1]), goal]

    def _nearest(self, point: Point) -> tuple[int, int]:
        """Return the passable cell nearest to a point."""
        away = self._passable - self._grid.cell_of(np.array([point], dtype=np.float64))
        row, column = self._passable[np.argmin((away**2).sum(axis=1))].tolist()
        return row, column

    def _straightened(self, cells: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the corners of a path: between them it is straight, at the same clearance."""
        corners, here = [0], 0
        while here < len(cells) - 1:
            there = len(cells) - 1
            while there > here + 1 and not self._sees(cells, here, there):
                there = here + max(1, (there - here) * 3 // 4)
            corners.append(there)
            here = there
        return cells[corners]

    def _sees(self, cells: NDArray[np.int64], here: int, there: int) -> bool:
        """Return whether the straight line between two cells keeps the path's clearance."""
        most = self._costs[tuple(cells[here : there + 1].T)].max()
        ends = cells[[here, there]].astype(np.float64)
        count = 2 * int(np.abs(ends[1] - ends[0]).max()) + 1
        line = np.rint(np.linspace(ends[0], ends[1], count)).astype(np.int64)
        return bool(self._costs[tuple(line.T)].max() <= most)
