"""Cost of a place to a robot, for people to look at."""

from __future__ import annotations

import numpy as np

from robotctl.model.grid_map import OCCUPIED, UNKNOWN, GridMap
from robotctl.planning.map.planning_map import PlanningMap


def costs_of(space: PlanningMap, comfort_m: float) -> GridMap:
    """Return a map of costs in percent, in cells of twice the side.

    100: the body touches something there, however it is turned; 0: it has the room of a comfortable
    distance; -1: nothing is known. The worst of four cells counts.

    Parameters
    ----------
    space
        The map, with the robot's size.
    comfort_m
        Beyond this clearance of the body a place costs nothing [m], > 0.
    """
    rows, columns = (cells - cells % 2 for cells in space.shape)
    side_m = space.grid.resolution_m
    room_m = (space.clearance[:rows, :columns] - space.inscribed) * side_m
    percent = np.clip(np.ceil(OCCUPIED * (1.0 - room_m / comfort_m)), 0, OCCUPIED)
    unknown = (space.grid.cells[:rows, :columns] < 0) & (percent < OCCUPIED)
    cells = np.where(unknown, UNKNOWN, percent).astype(np.int8)
    worst = cells.reshape(rows // 2, 2, columns // 2, 2).max(axis=(1, 3))
    return GridMap(worst, 2.0 * side_m, space.grid.origin)
