"""Boxes and cylinders at random places that are on no map."""

from __future__ import annotations

import argparse
import dataclasses
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from firmware_sim.command_line import parse_natural
from firmware_sim.errors import SimulationError
from firmware_sim.world.free_space import FreeSpace
from firmware_sim.world.shapes import Obstacle
from firmware_sim.world.world import OBSTACLE, World, load_world, things_of

CLEAR_M = 0.6
"""Clearance around the robot's start and other places [m]."""
APART_M = 0.05
"""Minimum gap to all other objects [m]."""
SMALLEST_M, LARGEST_M = 0.2, 0.5
HEIGHT_M = 0.6
"""Height of clutter, visible to sonars, lidars and cameras [m]."""
_STREAM = 7


def cluttered(
    world: World,
    count: int,
    seed: int,
    keep_clear: Sequence[tuple[float, float]] = (),
) -> World:
    """Return a world with boxes and cylinders added.

    They may block the path to a goal.

    Parameters
    ----------
    world
        The room.
    count
        Number of objects, >= 0.
    seed
        Seed of the places.
    keep_clear
        Places to keep clear by `CLEAR_M` [m], in addition to the start.

    Raises
    ------
    SimulationError
        If there is no place for that many.
    """
    rng = np.random.default_rng([seed, _STREAM])
    start = world.start[:2]
    for number in range(count):
        obstacle = _draw(rng, number)
        radius_m = obstacle.radius_m or 0.5 * math.hypot(*(obstacle.size or ()))
        places = FreeSpace(world, radius_m + APART_M, start).places
        for place in (start, *keep_clear):
            places = places[np.hypot(*(places - place).T) >= radius_m + CLEAR_M]
        if not len(places):
            raise SimulationError(
                f"{world.name}: has room for {number} pieces of clutter, {count} asked for"
            )
        x_m, y_m = places[rng.integers(len(places))].tolist()
        (thing,) = things_of(dataclasses.replace(obstacle, centre=(x_m, y_m)), OBSTACLE)
        world = dataclasses.replace(world, things=(*world.things, thing))
    return world


def load_cluttered(
    path: Path,
    start: tuple[float, float, float] | None,
    count: int,
    seed: int,
    keep_clear: Sequence[tuple[float, float]],
) -> World:
    """Return the world of a file with clutter, for a robot that starts there or at its start.

    Raises
    ------
    SimulationError
        If the file is invalid, or there is no place for that many.
    """
    world = load_world(path)
    if start is not None:
        world = dataclasses.replace(world, start=start)
    return cluttered(world, count, seed, keep_clear)


def add_options(add: Callable[..., object]) -> None:
    """Add the options of clutter to a command line."""
    add(
        "--clutter",
        type=parse_natural,
        default=0,
        help="boxes and cylinders on no map (%(default)s)",
    )
    add(
        "--keep-clear",
        type=_place,
        action="append",
        default=[],
        metavar="X,Y",
        help="where no clutter stands, besides the start",
    )


def _place(text: str) -> tuple[float, float]:
    """Return metres of X,Y."""
    try:
        x_m, y_m = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not X,Y") from None
    return x_m, y_m


def _draw(rng: np.random.Generator, number: int) -> Obstacle:
    """Return a box or a cylinder, not yet placed."""
    name, is_round = f"clutter {number + 1}", rng.random() < 0.5
    a_m, b_m = rng.uniform(SMALLEST_M, LARGEST_M, 2).round(3).tolist()
    heading_deg = round(float(rng.uniform(0.0, 180.0)), 1)
    if is_round:
        return Obstacle((0.0, 0.0), HEIGHT_M, radius_m=0.5 * a_m, name=name)
    return Obstacle((0.0, 0.0), HEIGHT_M, size=(a_m, b_m), heading_deg=heading_deg, name=name)
