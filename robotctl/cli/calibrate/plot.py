"""A calibration as a picture: reference and dead reckoning before and after."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robotctl.cli.picture import drawing
from robotctl.estimation.odometry.model import Array
from robotctl.estimation.odometry.runs import OdometryRun, points_at, poses_at
from robotctl.model.geometry.points import align
from robotctl.model.geometry.se2 import SE2
from robotctl.workbench.odometry.calibrate_odometry import OdometryCalibrateResult


def save_plot(result: OdometryCalibrateResult, file: Path) -> None:
    """Draw one panel with the ends of all drives, or the path of a log."""
    with drawing(file, 10.0, 5.0) as figure:
        panels = figure.subplots(1, 2, squeeze=False)[0]
        found = result.found
        sides = (("before", found.model.nothing), ("after", found.change))
        for panel, (when, change) in zip(panels, sides, strict=True):
            for i, run in enumerate(result.runs):
                lever_m, delay_s = (
                    (found.lever_m, found.delay_s) if when == "after" else (np.zeros(2), 0.0)
                )
                seen = run.reference[:, :2]
                at = _track(run, found.model.moves(change, run.rolled), lever_m, delay_s)
                label = "dead reckoning" if i == 0 else None
                panel.plot(*at.T, color="tab:blue", linewidth=0.8, label=label)
                panel.plot(*at[-1], "o", color="tab:blue", markersize=3)
                style = "x" if len(seen) == 1 else "."
                label = "reference" if i == 0 else None
                panel.plot(*seen.T, style, color="tab:red", markersize=4, label=label)
            panel.set_title(when)
            panel.set_aspect("equal")
            panel.set_xlabel("x, m")
            panel.grid(visible=True, alpha=0.3)
        panels[0].set_ylabel("y, m")
        panels[0].legend()
        figure.suptitle(f"{result.config.robot.name}: odometry before and after calibration")


def _track(run: OdometryRun, moves: Array, lever_m: Array, delay_s: float) -> Array:
    """Return dead reckoning at all times, laid onto the reference where the start is unknown."""
    if run.start is not None:
        return points_at(poses_at(run, moves, run.start, run.stamps_s), lever_m)
    seen = points_at(poses_at(run, moves, SE2(), run.reference_s - delay_s), lever_m)
    T = align(seen, run.reference[:, :2])
    return points_at(poses_at(run, moves, T, run.stamps_s), lever_m)
