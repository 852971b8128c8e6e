"""`robotctl localize`: a filter of the live robot on a recorded drive, against its reference."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from robotctl.app.localisation_map import load_localisation_map
from robotctl.app.localize_ekf import run_ekf
from robotctl.app.localize_mcl import run_mcl
from robotctl.app.localize_options import LocalizeOptions, Progress
from robotctl.app.localize_report import Run, report
from robotctl.app.localize_walls import run_wall_ekf
from robotctl.model.grid_map import GridMap
from robotctl.model.recording import Recording
from robotctl.model.trajectory import Trajectory
from robotctl.telemetry.recorded_log import read_recording


@dataclass(frozen=True, slots=True)
class Localized:
    """The outcome.

    Parameters
    ----------
    recording
        What was read.
    grid
        The map, where there was one.
    run
        What the filter did.
    report
        Its figures; the keys stand in docs/localisation.md.
    """

    recording: Recording
    grid: GridMap | None
    run: Run
    report: dict[str, Any]

    @property
    def trajectory(self) -> Trajectory:
        """The estimated poses."""
        estimates = self.run.estimates
        return Trajectory.of(
            (each.stamp_ns for each in estimates), (each.pose for each in estimates)
        )


def localize(options: LocalizeOptions, progress: Progress) -> Localized:
    """Run a filter on a log.

    Raises
    ------
    RobotctlError
        If log or map are wrong, or do not go together with each other and the method.
    OSError
        If a file cannot be read.
    """
    chart = load_localisation_map(options.map, Path()) if options.map else None
    recording = read_recording(
        options.log,
        options.mrclam_robot,
        time_unit=options.time_unit,
        max_range_m=options.max_range_m,
    )
    rng = np.random.default_rng(options.seed)
    if options.method == "mcl" and chart is not None:
        run = run_mcl(recording, options, chart, rng, progress)
    elif chart is not None and chart.walls is not None and recording.sonar_mounts:
        run = run_wall_ekf(recording, options, chart.walls, rng, progress)
    else:
        run = run_ekf(recording, options, rng, progress)
    return Localized(
        recording,
        chart.grid if chart else None,
        run,
        report(run, with_nees=options.method == "ekf"),
    )
