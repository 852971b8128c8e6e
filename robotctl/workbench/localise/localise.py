"""`robotctl localise`: a filter of the live robot on a recorded drive, against its reference."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from robotctl.logs.formats.recorded_log import read_recording, read_reference
from robotctl.maps.localisation_map import load_localisation_map
from robotctl.model.grid_map import GridMap
from robotctl.model.recording import Recording
from robotctl.model.trajectory import Trajectory
from robotctl.model.world_map import WorldMap
from robotctl.workbench.localise.ekf import run_ekf
from robotctl.workbench.localise.mcl import run_mcl
from robotctl.workbench.localise.options import LocaliseError, LocaliseOptions, Progress
from robotctl.workbench.localise.report import Run, report
from robotctl.workbench.localise.walls import run_wall_ekf


@dataclass(frozen=True, slots=True)
class Localised:
    """The outcome.

    Parameters
    ----------
    recording
        The input.
    grid
        The map, where there was one.
    run
        The filter's run.
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


def localise(options: LocaliseOptions, progress: Progress) -> Localised:
    """Run a filter on a log.

    Raises
    ------
    RobotctlError
        If log or map are wrong, or do not go together with each other and the method.
    OSError
        If a file cannot be read.
    """
    return localise_seeds(options, 1, progress)[0]


def localise_seeds(options: LocaliseOptions, seeds: int, progress: Progress) -> list[Localised]:
    """Run a filter on a log several times, with consecutive seeds from that of the options.

    Raises
    ------
    RobotctlError
        If log or map are wrong, or do not go together with each other and the method.
    OSError
        If a file cannot be read.
    """
    world_map = load_localisation_map(options.map, Path()) if options.map else None
    recording = read_recording(
        options.log,
        options.mrclam_robot,
        time_unit=options.time_unit,
        max_range_m=options.max_range_m,
        sweep_s=options.sweep_s,
    )
    if options.reference is not None:
        recording = _with_reference(recording, options.reference)
    return [
        _run(
            replace(options, seed=options.seed + number),
            recording,
            world_map,
            lambda done, of, before=number: progress(before * of + done, seeds * of),  # type: ignore[misc]
        )
        for number in range(seeds)
    ]


def _run(
    options: LocaliseOptions,
    recording: Recording,
    world_map: WorldMap | None,
    progress: Progress,
) -> Localised:
    """Run a filter with one seed."""
    rng = np.random.default_rng(options.seed)
    if options.method == "mcl" and world_map is not None:
        run = run_mcl(recording, options, world_map, rng, progress)
    elif world_map is not None and world_map.walls is not None and recording.sonar_mounts:
        run = run_wall_ekf(recording, options, world_map.walls, rng, progress)
    else:
        run = run_ekf(recording, options, rng, progress)
    return Localised(
        recording,
        world_map.grid if world_map else None,
        run,
        report(run, with_nees=options.method == "ekf") | {"notes": [*recording.notes, *run.notes]},
    )


def _with_reference(recording: Recording, file: Path) -> Recording:
    """Return a recording whose reference is that of a TUM file, or of another log.

    Raises
    ------
    LocaliseError
        If it is of another time than the recording.
    LogFormatError, OSError
        If the file cannot be read.
    """
    reference, has_heading = read_reference(file)
    stamps_ns = [entry.scan.stamp_ns for entry in recording.scans]
    if recording.odometry is not None:
        stamps_ns += [int(recording.odometry.stamps_ns[0]), int(recording.odometry.stamps_ns[-1])]
    stamps_ns += recording.twist_stamps_ns[[0, -1]].tolist() if len(recording.twists) else []
    spans = [
        1e-9 * int(at) for at in (*reference.stamps_ns[[0, -1]], min(stamps_ns), max(stamps_ns))
    ]
    if spans[1] < spans[2] or spans[3] < spans[0]:
        raise LocaliseError(
            f"--reference {file}: has times from {spans[0]:.3f} to {spans[1]:.3f} s, and "
            f"{recording.name} from {spans[2]:.3f} to {spans[3]:.3f} s: of a different drive or "
            "clock"
        )
    scans = tuple(
        replace(entry, reference=reference.at(entry.scan.stamp_ns)) for entry in recording.scans
    )
    return replace(recording, scans=scans, reference=reference, reference_has_heading=has_heading)
