"""Motions of the plane that carry a map nearly onto itself: by them a search mistakes one place.

The walls are correlated with themselves, turned by 0, 90, 180 and 270 degrees, at all shifts at
once (by the convolution theorem). Buildings that resemble themselves do so by these turns; a peak
of the correlation is a shift at which many walls fall on walls.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage  # type: ignore[import-untyped]

from robotctl.estimation.mcl.tuning import SearchConfig
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import OCCUPIED_FROM, STRIP, GridMap

_CELL_M: Final = 0.2
"""Side of a cell of the picture that is correlated [m]."""
_CELLS: Final = 512
"""Cells of a side at most; those of a large map are larger."""
_PEAKS: Final = 6
"""Number of peaks that are kept for each turn."""
_APART_M: Final = 1.0
"""Minimum distance between peaks, and minimum shift without a turn."""


def symmetries(grid: GridMap, config: SearchConfig | None = None) -> list[SE2]:
    """Return motions T, in world, such that walls of the map lie about where T puts others.

    A robot at a pose p sees at T @ p about the same. The motions are good to a cell of 0.2 m, or
    to 1/512 of a large map.
    """
    least = (config or SearchConfig()).symmetry_min
    strips = range(0, grid.shape[0], STRIP)
    walls_in = [
        np.argwhere(grid.rows(i, i + STRIP) >= OCCUPIED_FROM) + np.array([i, 0]) for i in strips
    ]
    points = grid.centre_of(np.concatenate(walls_in))
    if len(points) == 0:
        return []
    low = points.min(axis=0)
    side_m = max(_CELL_M, float(np.ptp(points, axis=0).max()) / _CELLS)
    cells = np.floor((points - low) / side_m).astype(np.int64)
    walls = np.zeros(cells.max(axis=0) + 1, np.float32)
    walls[cells[:, 0], cells[:, 1]] = 1.0
    walls = ndimage.gaussian_filter(walls, 1.0, mode="constant", truncate=3.0)
    found = []
    for quarters in range(4):
        turned = np.rot90(walls, quarters)
        for shift in _shifts(walls, turned, quarters, _APART_M / side_m, least):
            turn = SE2(0.0, 0.0, math.remainder(quarters * math.pi / 2.0, math.tau))
            corner = _corner(walls.shape, quarters)
            # Index i of the turned picture is the point turn @ (point of walls) - corner.
            x, y = (shift - corner) * side_m
            at_low, to_low = SE2(low[0], low[1], 0.0), SE2(-low[0], -low[1], 0.0)
            found.append(at_low @ SE2(x, y, 0.0) @ turn @ to_low)
    return found


def _corner(shape: tuple[int, ...], quarters: int) -> NDArray[np.float64]:
    """Return the least (x, y) of a picture of a shape after it was turned about (0, 0) [cells]."""
    rows, columns = shape
    corners = np.array([[0.0, 0.0], [rows, 0.0], [0.0, columns], [rows, columns]])
    c, s = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[quarters]
    turned = np.stack(
        [c * corners[:, 0] - s * corners[:, 1], s * corners[:, 0] + c * corners[:, 1]]
    )
    least: NDArray[np.float64] = turned.min(axis=1)
    return least


def _shifts(
    walls: NDArray[np.float64],
    turned: NDArray[np.float64],
    quarters: int,
    apart: float,
    least: float,
) -> NDArray[np.float64]:
    """Return by how much `turned` is shifted so that it falls on `walls`, (n, 2) [cells]."""
    size = [fft.next_fast_len(a + b) for a, b in zip(walls.shape, turned.shape, strict=True)]
    spectrum = fft.rfft2(walls, size) * np.conj(fft.rfft2(turned, size))
    alike = fft.irfft2(spectrum, size) / float(np.sum(walls * walls))
    if quarters == 0:
        for row in (slice(None, math.ceil(apart)), slice(-math.ceil(apart), None)):
            alike[row, : math.ceil(apart)] = alike[row, -math.ceil(apart) :] = 0.0
    width = 2 * math.ceil(apart) + 1
    peaks = (alike == ndimage.maximum_filter(alike, width, mode="wrap")) & (alike >= least)
    at = np.argwhere(peaks)
    shifts: NDArray[np.float64] = at[np.argsort(-alike[peaks])][:_PEAKS].astype(np.float64)
    for axis in range(2):
        shifts[shifts[:, axis] > walls.shape[axis], axis] -= size[axis]
    return shifts
