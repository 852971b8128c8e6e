"""A localised drive as a picture; needs the extra `plot`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robotctl.model.grid_map import GridMap
from robotctl.workbench.localize.localize import Localized
from robotctl.workbench.localize.report import position_errors


def save_plot(result: Localized, file: Path) -> None:
    """Draw map, reference and estimate, and the distance between the two over time."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra

    figure = Figure(figsize=(9.0, 10.0), dpi=120, layout="constrained")
    above, below = figure.subplots(2, 1, height_ratios=(3, 1))
    if result.grid is not None:
        _draw_map(above, result.grid)
    for x, y in result.recording.landmarks.values():
        above.plot(x, y, "k^", markersize=5)
    known = [(each.x_m, each.y_m) for each in result.run.references if each is not None]
    if known:
        above.plot(*np.array(known).T, color="tab:green", linewidth=2.5, label="reference")
    trajectory = result.trajectory
    above.plot(
        trajectory.poses[:, 0],
        trajectory.poses[:, 1],
        color="tab:red",
        linewidth=1.0,
        label="estimate",
    )
    above.set_aspect("equal", adjustable="datalim")
    above.set_xlabel("x, m")
    above.set_ylabel("y, m")
    above.legend(loc="upper right")
    time_s = 1e-9 * (trajectory.stamps_ns - trajectory.stamps_ns[0])
    below.plot(time_s, position_errors(result.run), linewidth=0.8)
    below.set_xlabel("time, s")
    below.set_ylabel("position error, m")
    below.set_ylim(bottom=0.0)
    below.grid(visible=True, alpha=0.3)
    figure.suptitle(result.recording.name)
    figure.savefig(file)


def _draw_map(axes: Any, grid: GridMap) -> None:
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
