"""Random poses where a robot can be."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.model.grid_map import STRIP, GridMap

SampleFree: TypeAlias = Callable[[np.random.Generator, int], NDArray[np.float64]]
"""Draws n poses (n, 3) [m, m, rad], uniform over the places and headings where a robot can be."""


def free_poses(grid: GridMap, inside: tuple[float, float] | None = None) -> SampleFree:
    """Return a sampler of poses in one connected region of a map's free cells.

    Other free cells cannot be reached: the inside of furniture, or what a lidar saw through a
    window. For walls, see `grid_of_walls`.

    Parameters
    ----------
    grid
        The map.
    inside
        A point (x, y) in world [m] of the region; None: the largest region.

    Raises
    ------
    ValueError
        If no cell is free, or that of `inside` is not.
    """
    return _sampler(grid, _region(grid, inside))


def free_area_m2(grid: GridMap) -> float:
    """Return the area of the largest connected region of free cells [m2]."""
    _, begins, ends = _region(grid, None)
    return int(np.sum(ends - begins)) * grid.resolution_m**2


def _region(
    grid: GridMap, inside: tuple[float, float] | None
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return one region as runs of cells: row, first column and end of each, (n,)."""
    rows, begins, ends = _runs(grid)
    if len(rows) == 0:
        raise ValueError("the map has no free cell: there is no place for a robot")
    regions = _regions(rows, begins, ends)
    if inside is None:
        region = int(np.argmax(np.bincount(regions, ends - begins)))
    else:
        row, column = (int(index) for index in grid.cell_of(np.array([inside]))[0])
        holds = np.flatnonzero((rows == row) & (begins <= column) & (column < ends))
        if len(holds) == 0:
            raise ValueError(f"inside must be a free point of the map, found {inside}")
        region = int(regions[holds[0]])
    own = regions == region
    return rows[own], begins[own], ends[own]


def _runs(grid: GridMap) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return all free cells as runs: row, first column and end of each, (n,), row by row."""
    starts, stops = [], []
    for row in range(0, grid.shape[0], STRIP):
        cells = grid.cells[row : row + STRIP]
        free = np.pad((cells >= 0) & (cells < 50), ((0, 0), (1, 1)))
        starts.append(np.argwhere(~free[:, :-1] & free[:, 1:]) + np.array([row, 0]))
        stops.append(np.argwhere(free[:, :-1] & ~free[:, 1:])[:, 1])
    first = np.concatenate(starts)
    return first[:, 0], first[:, 1], np.concatenate(stops)


@compiled
def _regions(
    rows: NDArray[np.int64], begins: NDArray[np.int64], ends: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return the region of each run, (n,): the number of its first run; sides of cells connect."""
    region = np.arange(len(rows))
    before = 0
    for k in range(len(rows)):
        above = rows[k] - 1
        while rows[before] < above or (rows[before] == above and ends[before] <= begins[k]):
            before += 1
        other = before
        while rows[other] == above and begins[other] < ends[k]:
            a, b = _root(region, other), _root(region, k)
            region[max(a, b)] = min(a, b)
            other += 1
    for k in range(len(rows)):
        region[k] = region[region[k]]
    return region


@compiled
def _root(region: NDArray[np.int64], run: int) -> int:
    """Return the first run of a region, and shorten the way to it."""
    while region[run] != run:
        region[run] = region[region[run]]
        run = region[run]
    return run


def _sampler(
    grid: GridMap, runs: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]
) -> SampleFree:
    """Return a sampler over the cells of runs."""
    rows, begins, ends = runs
    side_m, until = grid.resolution_m, np.cumsum(ends - begins)
    c, s = math.cos(grid.origin.theta_rad), math.sin(grid.origin.theta_rad)

    def sample(rng: np.random.Generator, count: int) -> NDArray[np.float64]:
        chosen = rng.integers(until[-1], size=count)
        # In order, they are found several times as fast.
        order, run = np.argsort(chosen), np.empty(count, np.int64)
        run[order] = np.searchsorted(until, chosen[order], side="right")
        columns = ends[run] - (until[run] - chosen)
        centres = grid.centre_of(np.stack([rows[run], columns], axis=1))
        u, v = side_m * (rng.random((2, count)) - 0.5)
        theta = rng.uniform(-math.pi, math.pi, count)
        x, y = centres[:, 0] + c * u - s * v, centres[:, 1] + s * u + c * v
        return np.stack([x, y, theta], axis=1)

    return sample
