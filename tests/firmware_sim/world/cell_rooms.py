"""Rooms of cells for tests, drawn and saved, and what a slow look at every cell says of them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from hypothesis import strategies as st

from firmware_sim.world.cells import Cells
from firmware_sim.world.world import World, load_world

SHADES = {"#": 0, ".": 254, " ": 205}
"""Of an occupied, a free and an unknown cell, as ROS's map savers have them."""

ROOM = """
####################
#..................#
#..................#
#...##.............#
#...##......#......#
#............#.....#
#.............#....#
#..............#...#
#..................#
#..#.#.............#
#.......##   ......#
#......###   ......#
#......###   ......#
#..................#
####################
"""


def room_map(
    folder: Path,
    drawing: str = ROOM,
    side_m: float = 0.25,
    times: int = 1,
    origin: tuple[float, float, float] | str = (-1.0, 2.0, 0.0),
    **keys: object,
) -> Path:
    """Write a map whose upper left corner is that of a drawing; return its yaml file.

    Each letter is `times` by `times` cells.
    """
    lines = drawing.strip("\n").splitlines()
    pixels = np.array([[SHADES[each] for each in line] for line in lines], np.uint8)
    pixels = np.kron(pixels, np.ones((times, times), np.uint8))
    header = f"P5\n{pixels.shape[1]} {pixels.shape[0]}\n255\n"
    (folder / "room.pgm").write_bytes(header.encode() + pixels.tobytes())
    corner = origin if isinstance(origin, str) else list(origin)
    values = {"image": "room.pgm", "resolution": side_m, "origin": corner, "free_thresh": 0.196}
    values |= keys
    path = folder / "room.yaml"
    path.write_text("".join(f"{key}: {value}\n" for key, value in values.items()))
    return path


def room_world(folder: Path, **keys: object) -> World:
    """Return the world that `room_map` writes."""
    return load_world(room_map(folder, **keys))


@st.composite
def cells(draw: st.DrawFn) -> Cells:
    """Draw a few cells, anywhere and at any angle; most are free."""
    rows, columns = draw(st.integers(1, 9)), draw(st.integers(1, 9))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    kinds = rng.choice(3, (rows, columns), p=[0.6, 0.3, 0.1])
    side_m = draw(st.sampled_from([0.03, 0.05, 0.5]))
    origin = (float(rng.uniform(-9, 9)), float(rng.uniform(-9, 9)), float(rng.uniform(-4, 4)))
    return Cells(kinds == 1, kinds == 0, side_m, origin)


def in_cells(cells: Cells, x: float, y: float) -> tuple[float, float]:
    """Return column and row of a point in world, with fractions."""
    ox, oy, theta = cells.origin
    c, s = math.cos(theta), math.sin(theta)
    dx, dy = x - ox, y - oy
    return (c * dx + s * dy) / cells.side_m, (-s * dx + c * dy) / cells.side_m


def ray_range(cells: Cells, x: float, y: float, bearing: float) -> float:
    """Return how far a ray goes to the first occupied cell [m]: by slabs, one cell at a time."""
    column, row = in_cells(cells, x, y)
    angle = bearing - cells.origin[2]
    direction = (math.cos(angle), math.sin(angle))
    nearest = math.inf
    for i, j in np.argwhere(cells.occupied):
        enter, leave = 0.0, math.inf
        for at, way, low in ((column, direction[0], j), (row, direction[1], i)):
            if abs(way) < 1e-12:
                if not low <= at <= low + 1:
                    leave = -1.0
                continue
            first, second = sorted(((low - at) / way, (low + 1 - at) / way))
            enter, leave = max(enter, first), min(leave, second)
        if enter <= leave:
            nearest = min(nearest, enter * cells.side_m)
    return nearest
