"""The room of a simulated run, as the simulator reads it."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

from firmware_sim.errors import SimulationError
from firmware_sim.world.clutter import cluttered
from firmware_sim.world.free_space import CELL_M, FreeSpace
from firmware_sim.world.world import World, load_world
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.errors import ConfigError
from robotctl.planning.behave.behaviours.goto import GotoItem
from robotctl.planning.behave.behaviours.straight_to import StraightToItem
from robotctl.planning.behave.mission.mission_file import Mission, StartPose

_SHORTEST_M = 0.5


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
        raise ConfigError(f"{world}: no walls found; a robot needs at least one")
    return room


def goal_mission(world: Path, start: tuple[float, ...], goal: tuple[float, ...]) -> str:
    """Return a mission of one goal, as TOML, at the speed of positions in GUIDED.

    Parameters
    ----------
    world
        Its file.
    start
        x, y and perhaps a heading [m, m, deg]; empty: where the world says.
    goal
        x, y and perhaps a heading [m, m, deg].

    Raises
    ------
    ConfigError
        If the world is wrong, or the goal lies outside.
    """
    room = load_room(world)
    low_x, low_y, high_x, high_y = room.bounds
    if not (low_x <= goal[0] <= high_x and low_y <= goal[1] <= high_y):
        raise ConfigError(
            f"--goal: x {goal[0]:g} m, y {goal[1]:g} m lies outside {room.name}: allowed are "
            f"x {low_x:g}..{high_x:g} m, y {low_y:g}..{high_y:g} m"
        )
    heading = f"heading_deg = {goal[2]:.9g}\n" if len(goal) == 3 else ""
    item = f'kind = "goto"\nx_m = {goal[0]:.9g}\ny_m = {goal[1]:.9g}\n{heading}'
    return _one_item(room, world, start, item)


def place_mission(world: Path, start: tuple[float, ...], place: str) -> str:
    """Return a mission to a place of the robot's topological map, as TOML, as `goal_mission`.

    Raises
    ------
    ConfigError
        If the world is wrong.
    """
    item = f'kind = "goto_place"\nplace = {json.dumps(place, ensure_ascii=False)}\n'
    return _one_item(load_room(world), world, start, item)


def _one_item(room: World, world: Path, start: tuple[float, ...], item: str) -> str:
    """Return the file of a mission of one item."""
    begin = StartPose(*start) if start else StartPose(*room.start[:2], math.degrees(room.start[2]))
    return (
        'name = "goal"\n'
        f"world = {json.dumps(str(world), ensure_ascii=False)}\n"
        f"start = {{ x_m = {begin.x_m:.9g}, y_m = {begin.y_m:.9g}, "
        f"heading_deg = {begin.heading_deg:.9g} }}\n"
        f"[[item]]\n{item}"
    )


def goals(mission: Mission) -> tuple[tuple[float, float], ...]:
    """Return x, y [m] of the goals of a mission, which stay clear of clutter."""
    return tuple(
        (item.x_m, item.y_m) for item in mission.item if isinstance(item, GotoItem | StraightToItem)
    )


def load_furnished(world: Path, options: SimOptions, mission: Mission) -> World:
    """Return the world of a run as the simulator has it, with what stands about.

    Raises
    ------
    ConfigError
        If the file is wrong, has no wall, or no room for so much clutter.
    """
    room, start = load_room(world), options.start_of(mission).pose
    room = dataclasses.replace(room, start=(start.x_m, start.y_m, start.theta_rad))
    try:
        return cluttered(room, options.clutter, options.seed, goals(mission))
    except SimulationError as error:
        raise ConfigError(f"--clutter {options.clutter}: {error}") from error


def straight_mission(world: Path) -> str:
    """Return a mission in a world, as TOML: from the place with the most room straight ahead.

    Raises
    ------
    ConfigError
        If the world is wrong, or has no straight line of half a metre from there.
    """
    room = load_room(world)
    cells = room.cells or FreeSpace(room, CELL_M / 2, room.start[:2]).cells()
    x_m, y_m, heading_rad, length_m = cells.clear_way()
    if length_m < _SHORTEST_M:
        raise ConfigError(
            f"{world}: too narrow to drive straight ahead from x {x_m:.2f} m, "
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
