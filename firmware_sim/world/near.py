"""Walls of a large room within the reach of a sensor, so that it need not try all."""

from __future__ import annotations

import math

import numpy as np

TILE_M = 2.0


class Near:
    """The rows of walls or corners that may matter to a sensor, by where the robot is.

    For each tile of the floor the rows are chosen when the robot first comes there, and keep their
    order: what a sensor makes of them is to the bit what it makes of all.

    Parameters
    ----------
    rows
        Walls (n, 4), from x, y to x, y, or corners (n, 6), x, y and more [m].
    reach_m
        How far from `base` a row may be that matters [m].
    """

    def __init__(self, rows: np.ndarray, reach_m: float) -> None:
        self._rows = rows
        self._begins = rows[:, :2]
        self._along = (rows[:, 2:4] if rows.shape[1] == 4 else self._begins) - self._begins
        self._square = np.maximum(np.sum(self._along**2, axis=1), 1.0e-12)
        self._reach_m = reach_m + TILE_M / math.sqrt(2.0)
        self.moving = rows[:0]
        """Rows of what moves, which follow those of the walls."""
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
