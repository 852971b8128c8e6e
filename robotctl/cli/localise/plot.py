"""A localised drive as a picture; needs the extra `plot`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robotctl.cli.picture import draw_map, drawing, see_from_above
from robotctl.workbench.localise.localise import Localised
from robotctl.workbench.localise.report import position_errors


def save_plot(result: Localised, file: Path) -> None:
    """Draw map, reference and estimate, and the distance between the two over time."""
    with drawing(file, 9.0, 10.0) as figure:
        above, below = figure.subplots(2, 1, height_ratios=(3, 1))
        if result.grid is not None:
            draw_map(above, result.grid)
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
        see_from_above(above, "datalim")
        above.legend(loc="upper right")
        time_s = 1e-9 * (trajectory.stamps_ns - trajectory.stamps_ns[0])
        below.plot(time_s, position_errors(result.run), linewidth=0.8)
        below.set_xlabel("time, s")
        below.set_ylabel("position error, m")
        below.set_ylim(bottom=0.0)
        below.grid(visible=True, alpha=0.3)
        figure.suptitle(result.recording.name)
