"""Free space of a round body in a room, and paths in it."""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Iterator

import numpy as np

from firmware_sim.world.cells import Cells
from firmware_sim.world.world import World

CELL_M = 0.1
MOST_CELLS = 250_000
STEPS = [(dx, dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1) if dx or dy]


class FreeSpace:
    """The cells in which the centre of a disc can be and that are connected to a place.

    Parameters
    ----------
    world
        The room, with its obstacles.
    radius_m
        Radius of the disc [m], >= 0.
    near
        Place x, y [m].
    """

    def __init__(self, world: World, radius_m: float, near: tuple[float, float]) -> None:
        low_x, low_y, high_x, high_y = world.bounds
        area_m2 = (high_x - low_x) * (high_y - low_y)
        self._cell_m = max(CELL_M, math.sqrt(area_m2 / MOST_CELLS))
        self._low = low_x, low_y
        shape = (
            math.ceil((high_y - low_y) / self._cell_m),
            math.ceil((high_x - low_x) / self._cell_m),
        )
        free = ~self._blocked(world, radius_m, shape)
        self._free = self._connected(free, near)
        self.places = self._middles(np.argwhere(self._free))
        """Middles of the free cells, (n, 2) [m]."""

    def _middles(self, cells: np.ndarray) -> np.ndarray:
        """Return x, y [m] of the middles of cells (n, 2) of rows and columns."""
        return self._low + (cells[:, ::-1] + 0.5) * self._cell_m

    def _blocked(self, world: World, radius_m: float, shape: tuple[int, int]) -> np.ndarray:
        """Return the cells where a disc would touch a wall, or be in one, or outside a map."""
        every = self._middles(np.argwhere(np.ones(shape, np.bool_)))
        blocked = np.zeros(shape, np.bool_)
        if world.cells is not None:
            blocked = ~world.cells.is_free(every).reshape(shape)
        for _, ring in world.solids:
            blocked |= _inside(every, ring).reshape(shape)
        for ax, ay, bx, by in world.touchable:
            low = (np.minimum((ax, ay), (bx, by)) - radius_m - self._low) / self._cell_m
            high = (np.maximum((ax, ay), (bx, by)) + radius_m - self._low) / self._cell_m
            columns, rows = (
                slice(max(math.floor(first), 0), max(math.ceil(last) + 1, 0))
                for first, last in zip(low, high, strict=True)
            )
            x = self._low[0] + (np.arange(shape[1])[columns] + 0.5) * self._cell_m - ax
            y = self._low[1] + (np.arange(shape[0])[rows, None] + 0.5) * self._cell_m - ay
            dx, dy = bx - ax, by - ay
            share = np.clip((x * dx + y * dy) / (dx * dx + dy * dy), 0.0, 1.0)
            blocked[rows, columns] |= np.hypot(x - share * dx, y - share * dy) <= radius_m
        return blocked

    def _connected(self, free: np.ndarray, near: tuple[float, float]) -> np.ndarray:
        """Return the free cells that are connected to the one nearest to a place."""
        from scipy import ndimage  # type: ignore[import-untyped] # noqa: PLC0415 - it takes 0.1 s

        cells = np.argwhere(free)
        if not len(cells):
            return np.zeros_like(free)
        # Since a step across a corner needs both sides, steps to the four sides reach the same.
        regions, _ = ndimage.label(free)
        row, column = cells[np.argmin(np.hypot(*(self._middles(cells) - near).T))]
        found: np.ndarray = regions == regions[row, column]
        return found

    @staticmethod
    def _neighbours(cell: tuple[int, int], free: np.ndarray) -> Iterator[tuple[int, int]]:
        """Yield the free cells next to one; across a corner only where both sides are free."""
        row, column = cell
        for dy, dx in STEPS:
            y, x = row + dy, column + dx
            inside = 0 <= y < free.shape[0] and 0 <= x < free.shape[1]
            if inside and free[y, x] and free[row, x] and free[y, column]:
                yield y, x

    def is_free(self, place: tuple[float, float]) -> bool:
        """Whether a place x, y [m] is in a free cell."""
        column, row = (
            math.floor((at - low) / self._cell_m) for at, low in zip(place, self._low, strict=True)
        )
        rows, columns = self._free.shape
        return 0 <= row < rows and 0 <= column < columns and bool(self._free[row, column])

    def way(self, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Return the corners of a short path between two of `places`, (k, 2) [m], both included."""
        first, last = self._cell(begin), self._cell(end)
        lengths, came = {first: 0.0}, {first: first}
        waiting = [(0.0, first)]
        while waiting:
            _, here = heapq.heappop(waiting)
            if here == last:
                break
            for cell in self._neighbours(here, self._free):
                length = lengths[here] + math.dist(here, cell)
                if length < lengths.get(cell, math.inf):
                    lengths[cell], came[cell] = length, here
                    heapq.heappush(waiting, (length + math.dist(cell, last), cell))
        cells = [last]
        while cells[-1] != first:
            cells.append(came[cells[-1]])
        return self._straightened(self._middles(np.array(cells[::-1])))

    def cells(self) -> Cells:
        """Return the free cells as those of a map."""
        return Cells(~self._free, self._free, self._cell_m, (*self._low, 0.0))

    def _cell(self, place: np.ndarray) -> tuple[int, int]:
        """Return row and column of a place."""
        column, row = np.floor((place - self._low) / self._cell_m).astype(int).tolist()
        return row, column

    def _straightened(self, corners: np.ndarray) -> np.ndarray:
        """Return the corners that remain when visible ones are joined directly."""
        kept, at = [corners[0]], 0
        while at < len(corners) - 1:
            seen = itertools.takewhile(
                lambda there, at=at: self._sees(corners[at], corners[there]),  # type: ignore[misc]
                range(at + 2, len(corners)),
            )
            at = max(seen, default=at + 1)
            kept.append(corners[at])
        return np.array(kept)

    def _sees(self, begin: np.ndarray, end: np.ndarray) -> bool:
        """Whether all cells along a straight line are free."""
        count = math.ceil(3.0 * float(np.hypot(*(end - begin))) / self._cell_m) + 1
        points = begin + np.linspace(0.0, 1.0, count)[:, None] * (end - begin)
        columns, rows = np.floor((points - self._low) / self._cell_m).astype(int).T
        return bool(self._free[rows, columns].all())


def _inside(points: np.ndarray, ring: np.ndarray) -> np.ndarray:
    """Return which points (n, 2) are inside a polygon (k, 2)."""
    result = np.zeros(len(points), np.bool_)
    x, y = points.T
    for (ax, ay), (bx, by) in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        if ay != by:
            crosses = (ay > y) != (by > y)
            result ^= crosses & (x < ax + (y - ay) * (bx - ax) / (by - ay))
    return result
