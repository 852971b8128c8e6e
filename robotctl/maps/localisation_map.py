"""The map that a robot localises itself in: a world's walls, or the cells of a ROS map."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robotctl.config.robot_file import MAPS
from robotctl.errors import ConfigError
from robotctl.estimation.grid.wall_raster import grid_of_walls
from robotctl.maps.map_file import load_map
from robotctl.maps.world import find_world, load_walls
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import UNKNOWN, GridMap
from robotctl.model.wall_map import WallMap
from robotctl.model.world_map import WorldMap

_FEWEST = 2
"""Minimum rows and columns, which show the direction of a wall."""


def find_map(name: str, beside: Path) -> Path:
    """Return the file of a map: of a ROS map, `.yaml`, or of a world.

    `beside` is the folder of the robot's file that names it.

    Raises
    ------
    ConfigError
        If there is no such file.
    """
    if not name:
        raise ConfigError("localisation.map: no map is given; a world (.toml) or a ROS map (.yaml)")
    return find_world(name, beside)


def load_localisation_map(name: str, beside: Path, cell_m: float = 0.05) -> WorldMap:
    """Read the map that `find_map` finds, for localisation; walls are drawn in cells of `cell_m`.

    Raises
    ------
    ConfigError
        If there is no such file, it is invalid, or no robot can localise itself in it.
    """
    found = load_any_map(name, beside, cell_m)
    if found.walls is None:
        _check_cells(found.grid, find_map(name, beside))
    return found


def load_any_map(name: str, beside: Path, cell_m: float = 0.05) -> WorldMap:
    """Read the map that `find_map` finds, as `load_localisation_map` does; it may be empty.

    Raises
    ------
    ConfigError
        If there is no such file, or it is invalid.
    """
    path = find_map(name, beside)
    try:
        if path.suffix.lower() in MAPS:
            return WorldMap(load_map(path), None)
        walls = load_walls(path)
    except ConfigError:
        from robotctl.logs.formats.recorded_log import is_log  # noqa: PLC0415 - loads all readers

        if is_log(path):
            raise ConfigError(
                f"{path}: a recorded log where a map is needed, a world (.toml) or a ROS map "
                "(.yaml)"
            ) from None
        raise
    return WorldMap(grid_of_walls(walls, cell_m), walls)


def off_map(world_map: WorldMap, start: SE2) -> str:
    """Return why a robot cannot start at a pose by its map; "" if it can."""
    grid = world_map.grid
    row, column = grid.cell_of(np.array([[start.x_m, start.y_m]]))[0].tolist()
    rows, columns = grid.cells.shape
    place = f"the start at x {round(start.x_m, 2):g} m, y {round(start.y_m, 2):g} m lies"
    if not (0 <= row < rows and 0 <= column < columns):
        width_m, height_m = columns * grid.resolution_m, rows * grid.resolution_m
        ends = [grid.origin.apply(x, y) for x in (0.0, width_m) for y in (0.0, height_m)]
        (low_x, low_y), (high_x, high_y) = np.min(ends, axis=0), np.max(ends, axis=0)
        return (
            f"{place} off the map, which has x {low_x:.2f} to {high_x:.2f} m and "
            f"y {low_y:.2f} to {high_y:.2f} m: is it the right map?"
        )
    cell = int(grid.cells[row, column])
    if cell == UNKNOWN:
        return f"{place} in an unknown part of the map: is it the right map?"
    return f"{place} in a wall of the map" if grid.occupied()[row, column] else ""


def _check_cells(grid: GridMap, path: Path) -> None:
    """Refuse a map in which no robot can localise itself.

    Raises
    ------
    ConfigError
        If it is such a map, with the reason.
    """
    rows, columns = grid.cells.shape
    hint = "are negate and the thresholds right?"
    if min(rows, columns) < _FEWEST:
        reason = f"has {columns} x {rows} cells, and a robot finds itself in two by two at least"
    elif not grid.free().any():
        reason = f"the map has no free cell: there is no place for a robot; {hint}"
    elif not grid.occupied().any():
        reason = f"the map has no obstacle, a cell of 50 % or more: all places look alike; {hint}"
    else:
        return
    raise ConfigError(f"{path}: {reason}")


def walls_of(world_map: WorldMap, name: str, method: str) -> WallMap:
    """Return the walls of the map called `name`, for a localiser that needs some.

    Raises
    ------
    ConfigError
        If it has only cells.
    """
    if world_map.walls is None:
        raise ConfigError(f"{name}: has cells; the {method.upper()} needs walls, a world (.toml)")
    return world_map.walls
