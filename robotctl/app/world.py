"""The walls of a world's file, as map and as picture; the simulator reads the rest of it."""

from __future__ import annotations

from pathlib import Path

from firmware_sim.errors import SimulationError
from firmware_sim.world import load_world
from robotctl.errors import ConfigError
from robotctl.model.wall_map import WallMap


def load_walls(world: Path) -> WallMap:
    """Return the walls of a world.

    Raises
    ------
    ConfigError
        If the file is wrong.
    """
    try:
        return WallMap(load_world(world).segments)
    except (SimulationError, ValueError) as error:
        raise ConfigError(str(error)) from error
