"""The things of a world as arrays for the camera: sides, heights, colours."""

from __future__ import annotations

import colorsys
import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from firmware_sim.camera.prints import NONE, Prints, prints_of, side_slots
from firmware_sim.world.shapes import Thing
from firmware_sim.world.world import OBSTACLE, World

# Columns of a side.
AX: Final = 0
AY: Final = 1
NX: Final = 2
NY: Final = 3
LENGTH: Final = 4
SHADE: Final = 5
_LIGHT_RAD = math.radians(35.0)
"""Direction that the brightest sides face [rad]."""


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """The objects of a world; a bare wall is a row of things with one side each.

    Attributes
    ----------
    sides
        (n, 6): first corner x, y, outward normal x, y, length [m], brightness. Walking along a
        side, its outside is on the right.
    owner
        Number of the thing of each side, (n,).
    first, count
        Sides of each thing, (m,).
    height
        Height of each thing, (m,) [m].
    colour
        Colour of each thing, (m, 3), blue, green, red.
    thing
        Index of each in `World.things`, (m,).
    prints
        Prints on the sides.
    """

    sides: np.ndarray
    owner: np.ndarray
    first: np.ndarray
    count: np.ndarray
    height: np.ndarray
    colour: np.ndarray
    thing: np.ndarray
    prints: Prints


def make_scene(world: World) -> Scene:
    """Return the things of a world as arrays."""
    sides: list[np.ndarray] = []
    first, count, height, colours, numbers = [], [], [], [], []
    slots: list[np.ndarray] = []
    number_of_sides = 0
    for number, thing in enumerate(world.things):
        rows = _sides(thing)
        colour = _colour(thing, world.floor.seed, number)
        rng = np.random.default_rng([world.floor.seed, 4, number])
        lengths_m = rows[:, LENGTH].tolist()
        bare = bool(thing.colour) or thing.kind == OBSTACLE
        slots += [NONE if bare else side_slots(each, thing.height_m, rng) for each in lengths_m]
        for part in [rows] if thing.solid else np.split(rows, len(rows)):
            first.append(number_of_sides)
            number_of_sides += len(part)
            count.append(len(part))
            sides.append(part)
            height.append(thing.height_m)
            colours.append(colour)
            numbers.append(number)
    together = np.ascontiguousarray(np.vstack([np.empty((0, 6)), *sides]))
    return Scene(
        sides=together,
        owner=np.repeat(np.arange(len(count), dtype=np.int64), count),
        first=np.array(first, dtype=np.int64),
        count=np.array(count, dtype=np.int64),
        height=np.array(height, dtype=np.float64),
        colour=np.array(colours, dtype=np.float64).reshape(-1, 3),
        thing=np.array(numbers, dtype=np.int64),
        prints=prints_of(slots, together[:, LENGTH]),
    )


def _sides(thing: Thing) -> np.ndarray:
    """Sides of a thing, those of a solid one counter-clockwise, (n, 6)."""
    rows = thing.sides()
    if thing.solid and np.sum(rows[:, 0] * rows[:, 3] - rows[:, 1] * rows[:, 2]) < 0.0:
        rows = rows[::-1][:, [2, 3, 0, 1]]
    along = rows[:, 2:] - rows[:, :2]
    length = np.hypot(along[:, 0], along[:, 1])
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1) / length[:, None]
    facing = normal @ np.array([math.cos(_LIGHT_RAD), math.sin(_LIGHT_RAD)])
    if not thing.solid:
        facing = np.abs(facing)
    shade = 0.84 + 0.12 * facing
    return np.column_stack([rows[:, :2], normal, length, shade])


def _colour(thing: Thing, seed: int, number: int) -> tuple[float, float, float]:
    """Blue, green, red of a thing: its own, else drawn from seed and number."""
    if thing.colour:
        whole = bytes.fromhex(thing.colour[1:])
        return float(whole[2]), float(whole[1]), float(whole[0])
    rng = np.random.default_rng([seed, 3, number])
    hue, saturation, value = rng.random(3)
    if thing.kind == "wall":
        saturation, value = 0.10 * saturation, 0.82 + 0.08 * value
    elif thing.kind == OBSTACLE:
        saturation, value = 0.6 + 0.35 * saturation, 0.35 + 0.5 * value
    else:
        hue, saturation, value = 0.04 + 0.1 * hue, 0.15 + 0.5 * saturation, 0.3 + 0.45 * value
    red, green, blue = colorsys.hsv_to_rgb(hue, saturation, value)
    return 255.0 * blue, 255.0 * green, 255.0 * red
