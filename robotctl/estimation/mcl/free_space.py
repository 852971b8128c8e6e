"""Random poses where a robot can be."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage  # type: ignore[import-untyped]

from robotctl.model.grid_map import GridMap

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
    return len(_region(grid, None)) * grid.resolution_m**2


def _region(grid: GridMap, inside: tuple[float, float] | None) -> NDArray[np.int64]:
    """Return (row, column) of the cells of one region, (n, 2)."""
    regions, count = ndimage.label(grid.free())
    if count == 0:
        raise ValueError("the map has no free cell: there is no place for a robot")
    if inside is None:
        region = 1 + int(np.argmax(np.bincount(regions.ravel())[1:]))
    else:
        row, column = (int(index) for index in grid.cell_of(np.array([inside]))[0])
        in_map = 0 <= row < regions.shape[0] and 0 <= column < regions.shape[1]
        region = int(regions[row, column]) if in_map else 0
        if region == 0:
            raise ValueError(f"inside must be a free point of the map, found {inside}")
    return np.argwhere(regions == region)


def _sampler(grid: GridMap, cells: NDArray[np.int64]) -> SampleFree:
    """Return a sampler over cells (n, 2)."""
    centres, side_m = grid.centre_of(cells), grid.resolution_m
    c, s = math.cos(grid.origin.theta_rad), math.sin(grid.origin.theta_rad)

    def sample(rng: np.random.Generator, count: int) -> NDArray[np.float64]:
        chosen = centres[rng.integers(len(centres), size=count)]
        u, v = side_m * (rng.random((2, count)) - 0.5)
        theta = rng.uniform(-math.pi, math.pi, count)
        return np.stack([chosen[:, 0] + c * u - s * v, chosen[:, 1] + s * u + c * v, theta], axis=1)

    return sample
