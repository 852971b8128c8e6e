"""Walls of a large room within the reach of a sensor, so that it need not try all of them."""

from __future__ import annotations

import math

import numpy as np

TILE_M = 2.0


class Near:
    """Rows of walls or corners that may matter to a sensor, by the robot's position.

    The rows of each tile of the floor are chosen when the robot first enters it, and keep their
    order, so that a sensor's result is bit for bit the same as with all rows.

    Parameters
    ----------
    rows
        Walls (n, 4), from x, y to x, y, or corners (n, 6), x, y and more [m].
    reach_m
        Distance from `base` up to which a row matters [m].
    """

    def __init__(self, rows: np.ndarray, reach_m: float) -> None:
        self._rows = rows
        self._begins = rows[:, :2]
        self._along = (rows[:, 2:4] if rows.shape[1] == 4 else self._begins) - self._begins
        self._square = np.maximum(np.sum(self._along**2, axis=1), 1.0e-12)
        self._reach_m = reach_m + TILE_M / math.sqrt(2.0)
        self.moving = rows[:0]
        """Rows of moving objects, which follow those of the walls."""
        self._chosen: dict[tuple[int, int], np.ndarray] = {}

    def at(self, x_m: float, y_m: float) -> np.ndarray:
        """Return the rows for a robot at x, y [m] in world."""
        tile = math.floor(x_m / TILE_M), math.floor(y_m / TILE_M)
        found = self._chosen.get(tile)
        if found is None:
            found = self._chosen[tile] = self._choose(tile)
        return np.vstack([found, self.moving]) if len(self.moving) else found

    def _choose(self, tile: tuple[int, int]) -> np.ndarray:
        """Return the rows within reach of anywhere in a tile."""
        offset = (np.array(tile) + 0.5) * TILE_M - self._begins
        share = np.clip(np.sum(offset * self._along, axis=1) / self._square, 0.0, 1.0)
        apart = np.hypot(*(offset - share[:, None] * self._along).T)
        return np.ascontiguousarray(self._rows[apart <= self._reach_m])
