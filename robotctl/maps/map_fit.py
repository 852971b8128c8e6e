"""Agreement of a localiser's map with the world of a simulated robot."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.config.robot_file import RobotConfig
from robotctl.maps.localisation_map import find_map, load_localisation_map
from robotctl.model.grid_map import GridMap
from robotctl.model.wall_map import WallMap

_NEAR_M: Final = 0.3
_APART_M: Final = 0.1
"""Spacing of the points of a wall that are compared [m]."""
_FITS: Final = 0.6
"""Minimum of the larger share; a map of less or more than the world has one high share."""


def misfit(config: RobotConfig, robot: Path, world: Path, walls: WallMap) -> str:
    """Return why the map of a robot's localiser does not fit its world; "" if it does.

    Parameters
    ----------
    config, robot
        Robot and its file.
    world, walls
        World in which it drives.

    Raises
    ------
    ConfigError, OSError
        If the map cannot be read.
    """
    settings = config.localisation
    if settings.method == "none":
        return ""
    beside = robot.resolve().parent
    if find_map(settings.map, beside).resolve() == world:
        return ""
    of_map, of_walls = shares_near(load_localisation_map(settings.map, beside).grid, walls)
    if max(of_map, of_walls) >= _FITS:
        return ""
    return (
        f"the map {settings.map} does not fit the world {world.name}: {100 * of_map:.0f} % of the "
        f"map's obstacles have a wall of the world within {_NEAR_M} m, and {100 * of_walls:.0f} % "
        "of the world's walls an obstacle of the map; the robot will not find itself in it"
    )


def shares_near(grid: GridMap, walls: WallMap) -> tuple[float, float]:
    """Return the share of a map's obstacles near a wall, and the share of walls near obstacles."""
    from scipy.spatial import cKDTree  # type: ignore[import-untyped] # noqa: PLC0415 - it is slow

    shown, stands = grid.centre_of(np.argwhere(grid.occupied())), _points(walls)
    shares = []
    for these, those in ((shown, stands), (stands, shown)):
        apart, _ = cKDTree(those).query(these, distance_upper_bound=_NEAR_M)
        shares.append(float(np.mean(np.isfinite(apart))))
    return shares[0], shares[1]


def _points(walls: WallMap) -> NDArray[np.float64]:
    """Return points along all walls, (n, 2) [m]."""
    rows = []
    for ax, ay, bx, by in walls.segments:
        share = np.linspace(0.0, 1.0, math.ceil(math.hypot(bx - ax, by - ay) / _APART_M) + 1)
        rows.append(np.stack([ax + share * (bx - ax), ay + share * (by - ay)], axis=1))
    return np.concatenate(rows)
