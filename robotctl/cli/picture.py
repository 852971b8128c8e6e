"""Pictures that commands draw; they need the extra `plot`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.grid_map import UNKNOWN, GridMap

_PIXELS: Final = 1600
"""Sides of a picture of a map at most: matplotlib takes some 20 bytes for each."""


@contextmanager
def drawing(file: Path, width: float, height: float, dpi: int = 120) -> Iterator[Any]:
    """Yield a figure of matplotlib of so many inches, and save it."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra

    figure = Figure(figsize=(width, height), dpi=dpi, layout="constrained")
    yield figure
    figure.savefig(file)


def see_from_above(axes: Any, adjustable: str = "box") -> None:
    """Show a plane to scale, x and y in metres."""
    axes.set_aspect("equal", adjustable=adjustable)
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")


def draw_map(axes: Any, grid: GridMap) -> None:
    """Draw a map where it lies in the world; a turned one by its occupied cells."""
    if grid.origin.theta_rad == 0.0:
        x, y, side = grid.origin.x_m, grid.origin.y_m, grid.resolution_m
        cells, side = _shrunk(grid.cells, side)
        extent = (x, x + cells.shape[1] * side, y, y + cells.shape[0] * side)
        shades = np.where(cells < 0, np.float32(0.85), 1.0 - np.float32(0.01) * cells)
        axes.imshow(shades, cmap="gray", vmin=0.0, vmax=1.0, origin="lower", extent=extent)
        return
    points: NDArray[np.float64] = grid.centre_of(np.argwhere(grid.occupied()))
    axes.plot(points[:, 0], points[:, 1], "k,", alpha=0.5)


def draw_costs(axes: Any, costs: GridMap) -> None:
    """Draw costs [%] over a map that is not turned, from pale to dark; what costs nothing, not."""
    if costs.origin.theta_rad == 0.0:
        x, y = costs.origin.x_m, costs.origin.y_m
        cells, side = _shrunk(costs.cells, costs.resolution_m)
        extent = (x, x + cells.shape[1] * side, y, y + cells.shape[0] * side)
        shown = np.ma.masked_less_equal(cells, 0)
        axes.imshow(
            shown, cmap="YlOrRd", vmin=0, vmax=130, alpha=0.5, origin="lower", extent=extent
        )


def _shrunk(cells: NDArray[np.int8], side_m: float) -> tuple[NDArray[np.int8], float]:
    """Return the greatest of each block of cells, at most `_PIXELS` a side, and a block's side."""
    block = -(-max(cells.shape) // _PIXELS)
    rows, columns = (-(-size // block) for size in cells.shape)
    spare = [
        (0, whole * block - size) for whole, size in zip((rows, columns), cells.shape, strict=True)
    ]
    padded = np.pad(cells, spare, constant_values=UNKNOWN)
    blocks = padded.reshape(rows, block, columns, block)
    return blocks.max(axis=(1, 3)), block * side_m
