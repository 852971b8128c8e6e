"""Light on the floor: lamps below the ceiling and soft shadows of objects."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from firmware_sim.camera.scene import Scene
from firmware_sim.world.world import Lamp, World
from native_kernels.compiled import compiled

CEILING_M = 2.4
"""Default height of lamps [m]."""
SPACING_M = 3.6
REACH_M = 8.0
RADIUS_M = 0.12
"""Radius of a lamp [m]: it makes the shadows soft."""
POINTS = 6
"""Points that make up a lamp."""
EVEN = 0.95
CELL_M = 0.02
MAX_CELLS = 4_000_000
MARGIN_M = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    """Brightness of the floor, about 0.95 in the mean of lit places.

    Attributes
    ----------
    cells
        (rows, columns) float32; row 0 at the lowest y.
    x_m, y_m
        Middle of cell 0, 0 in world.
    cell_m
        Cell size [m].
    """

    cells: np.ndarray
    x_m: float
    y_m: float
    cell_m: float


def floor_light(world: World, scene: Scene, ambient: float) -> Light:
    """Return the brightness of a world's floor; `ambient` is the share without shadows.

    A map has no lamps: its floor is lit evenly.
    """
    low_x, low_y, high_x, high_y = world.bounds
    if world.cells is not None:
        return Light(np.full((2, 2), EVEN, dtype=np.float32), low_x, low_y, CELL_M)
    width, depth = high_x - low_x + 2 * MARGIN_M, high_y - low_y + 2 * MARGIN_M
    cell = max(CELL_M, math.sqrt(width * depth / MAX_CELLS))
    shape = (max(2, math.ceil(depth / cell)), max(2, math.ceil(width / cell)))
    direct = np.zeros(shape, dtype=np.float32)
    x_m, y_m = low_x - MARGIN_M + cell / 2, low_y - MARGIN_M + cell / 2
    hidden = np.empty(shape, dtype=np.uint8)
    height = scene.height[scene.owner]
    lamps = world.lamps or _ceiling_lamps(world)
    turn = np.arange(POINTS) * (2.0 * math.pi / POINTS)
    for lamp in lamps:
        for dx, dy in RADIUS_M * np.stack([np.cos(turn), np.sin(turn)], axis=1):
            point = np.array([lamp.at[0] + dx, lamp.at[1] + dy, lamp.at[2], lamp.power])
            add_lamp(point, x_m, y_m, cell, scene.sides, height, hidden, direct)
    # Inside objects it is dark, otherwise light would show along their feet.
    hidden[:] = 0
    for first, count in zip(scene.first, scene.count, strict=True):
        x, y = scene.sides[first : first + count, :2].T.copy()
        if count > 1:
            hide(x, y, x_m / cell, y_m / cell, cell, 0, shape[1], 0, shape[0],
                 hidden)  # fmt: skip
    direct[hidden == 1] = 0.0
    lit = direct[direct > 0.0]
    if len(lit):
        direct *= np.float32(0.9 / lit.mean())
    cells = np.float32(ambient) + np.float32(1.0 - ambient) * direct
    return Light(cells, x_m, y_m, cell)


def _ceiling_lamps(world: World) -> list[Lamp]:
    """Return lamps on a grid, each shifted a little by the seed."""
    rng = np.random.default_rng([world.floor.seed, 4])
    low_x, low_y, high_x, high_y = world.bounds
    columns = max(1, round((high_x - low_x) / SPACING_M))
    rows = max(1, round((high_y - low_y) / SPACING_M))
    x = low_x + (np.arange(columns) + 0.5) * (high_x - low_x) / columns
    y = low_y + (np.arange(rows) + 0.5) * (high_y - low_y) / rows
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    places += rng.uniform(-0.4, 0.4, places.shape)
    return [Lamp((float(x), float(y), CEILING_M)) for x, y in places]


@compiled
def add_lamp(
    lamp: np.ndarray,
    x: float,
    y: float,
    cell: float,
    sides: np.ndarray,
    height: np.ndarray,
    hidden: np.ndarray,
    direct: np.ndarray,
) -> None:
    """Add the unobstructed light of one point (x, y, z, power)."""
    rows, columns = direct.shape
    i0 = max(0, math.floor((lamp[0] - REACH_M - x) / cell))
    i1 = min(columns, math.ceil((lamp[0] + REACH_M - x) / cell) + 1)
    j0 = max(0, math.floor((lamp[1] - REACH_M - y) / cell))
    j1 = min(rows, math.ceil((lamp[1] + REACH_M - y) / cell) + 1)
    hidden[j0:j1, i0:i1] = 0
    px, py = np.empty(4), np.empty(4)
    for k in range(len(sides)):
        ax, ay = sides[k, 0] - lamp[0], sides[k, 1] - lamp[1]
        bx, by = ax - sides[k, 3] * sides[k, 4], ay + sides[k, 2] * sides[k, 4]
        along = min(max(-(ax * (bx - ax) + ay * (by - ay)) / sides[k, 4] ** 2, 0.0), 1.0)
        if math.hypot(ax + along * (bx - ax), ay + along * (by - ay)) > 1.5 * REACH_M:
            continue
        # The shadow's far end, where the light over the top comes down; none from a tall one.
        far = min(lamp[2] / max(lamp[2] - height[k], 1.0e-3), 100.0)
        px[0], px[1], px[2], px[3] = ax, bx, far * bx, far * ax
        py[0], py[1], py[2], py[3] = ay, by, far * by, far * ay
        hide(px, py, (x - lamp[0]) / cell, (y - lamp[1]) / cell, cell, i0, i1, j0, j1, hidden)
    z2 = lamp[2] * lamp[2]
    for j in range(j0, j1):
        dy = y + j * cell - lamp[1]
        for i in range(i0, i1):
            if hidden[j, i] == 0:
                dx = x + i * cell - lamp[0]
                r2 = dx * dx + dy * dy
                if r2 < REACH_M * REACH_M:
                    fade = 1.0 - r2 / (REACH_M * REACH_M)
                    direct[j, i] += lamp[3] * fade * (z2 / (z2 + r2)) ** 1.5


@compiled
def hide(
    px: np.ndarray,
    py: np.ndarray,
    x0: float,
    y0: float,
    cell: float,
    i0: int,
    i1: int,
    j0: int,
    j1: int,
    hidden: np.ndarray,
) -> None:
    """Mark the cells whose middle lies in a convex polygon, row by row."""
    first = max(j0, math.ceil(py.min() / cell - y0))
    last = min(j1 - 1, math.floor(py.max() / cell - y0))
    for j in range(first, last + 1):
        y = (j + y0) * cell
        low, high = np.inf, -np.inf
        for k in range(len(px)):
            n = (k + 1) % len(px)
            if (py[k] > y) != (py[n] > y):
                x = px[k] + (y - py[k]) * (px[n] - px[k]) / (py[n] - py[k])
                low, high = min(low, x), max(high, x)
        begin = max(i0, math.ceil(low / cell - x0)) if low < np.inf else i1
        end = min(i1 - 1, math.floor(high / cell - x0)) if low < np.inf else i0 - 1
        for i in range(begin, end + 1):
            hidden[j, i] = 1
