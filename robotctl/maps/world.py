"""Where a simulated robot drives: the file of a world, or of a ROS map that is taken for one."""

from __future__ import annotations

import json
import math
from pathlib import Path

from firmware_sim.errors import SimulationError
from firmware_sim.world.world import World, load_world
from robotctl.config.robot_file import MAPS, TOML, find_file
from robotctl.errors import ConfigError
from robotctl.maps.map_file import refuse_image
from robotctl.model.wall_map import WallMap

_SHORTEST_M = 0.5


def find_world(name: str, beside: Path | None = None) -> Path:
    """Return the file of a world, `.toml`, or of a ROS map, `.yaml`; `find_file` says where it is.

    `beside` is the folder of the file that names it.

    Raises
    ------
    ConfigError
        If there is none.
    """
    refuse_image(name)
    return find_file(name, "worlds", (*TOML, *MAPS), beside=beside).resolve()


def load_room(world: Path) -> World:
    """Return a world as the simulator has it.

    Raises
    ------
    ConfigError
        If the file is wrong, or has no wall.
    """
    try:
        room = load_world(world)
    except SimulationError as error:
        raise ConfigError(str(error)) from error
    if len(room.segments) == 0:
        raise ConfigError(f"{world}: has no wall: a robot drives among some")
    return room


def load_walls(world: Path) -> WallMap:
    """Return the walls of a world.

    Raises
    ------
    ConfigError
        If the file is wrong, or has no wall.
    """
    return WallMap(load_room(world).segments)


def straight_mission(world: Path) -> str:
    """Return a mission in a map, as TOML: from the place with the most room straight ahead.

    Raises
    ------
    ConfigError
        If the map is wrong, or has no straight way of half a metre from there.
    """
    cells = load_room(world).cells
    if cells is None:
        raise ValueError(f"{world} is no map")
    x_m, y_m, heading_rad, length_m = cells.clear_way()
    if length_m < _SHORTEST_M:
        raise ConfigError(
            f"{world}: is too narrow for a robot to drive straight on from x {x_m:.2f} m, "
            f"y {y_m:.2f} m, where it has the most room; give it a --mission"
        )
    end = x_m + length_m * math.cos(heading_rad), y_m + length_m * math.sin(heading_rad)
    heading_deg = math.degrees(heading_rad)
    return (
        'name = "straight"\n'
        f"world = {json.dumps(str(world), ensure_ascii=False)}\n"
        f"start = {{ x_m = {x_m:.3f}, y_m = {y_m:.3f}, heading_deg = {heading_deg:.1f} }}\n"
        "[[item]]\n"
        'kind = "drive"\n'
        f"waypoints = [[{x_m:.3f}, {y_m:.3f}], [{end[0]:.3f}, {end[1]:.3f}]]\n"
    )
