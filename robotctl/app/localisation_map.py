"""The map that a robot localises itself in: a world's walls, or the cells of a ROS map."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from robotctl.app.config import find_file
from robotctl.app.map_file import load_map
from robotctl.app.world import load_walls
from robotctl.errors import ConfigError
from robotctl.estimation.wall_raster import grid_of_walls
from robotctl.model.grid_map import GridMap
from robotctl.model.wall_map import WallMap

CELLS = (".yaml", ".yml")
_IMAGES = (".pgm", ".png", ".bmp", ".jpg")
_FEWEST = 2
"""Rows and columns: the direction of a wall shows in two."""


@dataclass(frozen=True, slots=True, eq=False)
class LocalisationMap:
    """A map; `walls` is None where it knows cells alone."""

    grid: GridMap
    walls: WallMap | None


def find_map(name: str, beside: Path) -> Path:
    """Return the file of a map: `.yaml` is a ROS map, anything else the file or name of a world.

    A relative path counts from the folder `beside`, that of the robot's file, then from the working
    directory.

    Raises
    ------
    ConfigError
        If there is none.
    """
    if not name:
        raise ConfigError("localisation.map: no map is given; a world (.toml) or a ROS map (.yaml)")
    if name.endswith(_IMAGES):
        raise ConfigError(f"{name}: an image; needed is the map's .yaml that names it")
    here = beside / name
    if here.is_file():
        return here
    return find_file(name, "maps", ".yaml") if name.endswith(CELLS) else find_file(name, "worlds")


def load_localisation_map(name: str, beside: Path) -> LocalisationMap:
    """Read the map that `find_map` finds.

    Raises
    ------
    ConfigError
        If there is none, or it is wrong.
    """
    path = find_map(name, beside)
    if name.endswith(CELLS):
        grid = load_map(path)
        _check_cells(grid, path)
        return LocalisationMap(grid, None)
    walls = load_walls(path)
    return LocalisationMap(grid_of_walls(walls), walls)


def _check_cells(grid: GridMap, path: Path) -> None:
    """Refuse a map in which no robot can find itself.

    Raises
    ------
    ConfigError
        If it is; says why.
    """
    rows, columns = grid.cells.shape
    hint = "are negate and the thresholds right?"
    if min(rows, columns) < _FEWEST:
        reason = f"has {columns} x {rows} cells, and a robot finds itself in two by two at least"
    elif not grid.free().any():
        reason = f"the map has no free cell: a robot can be nowhere; {hint}"
    elif not grid.occupied().any():
        reason = f"the map has no obstacle, a cell of 50 % or more: all places look alike; {hint}"
    else:
        return
    raise ConfigError(f"{path}: {reason}")


def walls_for_ekf(chart: LocalisationMap, name: str) -> WallMap:
    """Return the walls of the map called `name`.

    Raises
    ------
    ConfigError
        If it has cells alone.
    """
    if chart.walls is None:
        raise ConfigError(f"{name}: has cells; the EKF needs walls, a world (.toml)")
    return chart.walls
