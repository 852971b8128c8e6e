"""A map in a picture; needs the extra `plot`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from robotctl.model.grid_map import GridMap


def draw_map(axes: Any, grid: GridMap) -> None:
    """Draw a map where it lies in the world; a turned one by its occupied cells."""
    if grid.origin.theta_rad == 0.0:
        rows, columns = grid.cells.shape
        x, y, side = grid.origin.x_m, grid.origin.y_m, grid.resolution_m
        extent = (x, x + columns * side, y, y + rows * side)
        shades = np.where(grid.cells < 0, 0.85, 1.0 - 0.01 * grid.cells)
        axes.imshow(shades, cmap="gray", vmin=0.0, vmax=1.0, origin="lower", extent=extent)
        return
    points: NDArray[np.float64] = grid.centre_of(np.argwhere(grid.occupied()))
    axes.plot(points[:, 0], points[:, 1], "k,", alpha=0.5)
