"""The map of the world that a robot is given: its cells, and its walls where it has some."""

from __future__ import annotations

from dataclasses import dataclass

from robotctl.model.grid_map import GridMap
from robotctl.model.wall_map import WallMap


@dataclass(frozen=True, slots=True, eq=False)
class WorldMap:
    """A given map, which no measurement changes.

    Both forms are kept because each is exact for somebody: cells for lidars and planners, walls for
    echoes of sonars and for the EKF, which needs lines.

    Parameters
    ----------
    grid
        Its cells.
    walls
        Its walls; None: it has only cells, as a ROS map.
    """

    grid: GridMap
    walls: WallMap | None
