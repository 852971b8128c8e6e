"""Runs that calibration works on, from logs and tape measures."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl import toml_source
from robotctl.errors import CalibrationError, ConfigError, InvalidValue
from robotctl.estimation.odometry.model import OdometryModel
from robotctl.estimation.odometry.runs import OdometryRun, thinned
from robotctl.logs.formats.recorded_log import read_recording
from robotctl.logs.formats.times import is_timeless
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import Recording
from robotctl.model.trajectory import Trajectory

SPACING_M: Final = 0.25
"""References nearer than this, as the wheels travel, are left out [m]."""

_LEAST = 12
_COUNTED = 2
"""Wheels that a log with counts has: the left and the right one."""


@dataclass(frozen=True, slots=True)
class MeasuredRun:
    """A drive from a mark on the floor, and its end by tape measure.

    Parameters
    ----------
    log
        The record of it, beside this file or with its whole path.
    x_m, y_m
        Final position of the middle of the axle, ahead and to the left of its start [m].
    heading_deg
        How far it is turned to the left against the start [deg]; may be left out.
    name
        What people call it; default: the log's name.
    """

    log: str
    x_m: float
    y_m: float
    heading_deg: float | None = None
    name: str = ""

    def __post_init__(self) -> None:
        for key in ("x_m", "y_m", "heading_deg"):
            value = getattr(self, key)
            if value is not None and not math.isfinite(value):
                raise InvalidValue(key, f"must be finite, found {value}", value)


@dataclass(frozen=True, slots=True)
class MeasuredRuns:
    """A file of measured runs.

    Parameters
    ----------
    run
        At least one, written as `[[run]]`.
    tape_sigma_m
        Standard deviation of the tape measure, and of placing the robot at its start [m], > 0.
    heading_sigma_deg
        Standard deviation of the heading in which the robot is placed [deg], > 0.
    """

    run: tuple[MeasuredRun, ...]
    tape_sigma_m: float = 0.002
    heading_sigma_deg: float = 0.5

    def __post_init__(self) -> None:
        if not self.run:
            raise ValueError("at least one [[run]] is needed")
        for key in ("tape_sigma_m", "heading_sigma_deg"):
            value = getattr(self, key)
            if not (math.isfinite(value) and value > 0.0):
                raise InvalidValue(key, f"must be positive and finite, found {value}", value)

    @property
    def start_sigma(self) -> tuple[float, float, float]:
        """Deviations of the start pose [m, m, rad]."""
        return self.tape_sigma_m, self.tape_sigma_m, math.radians(self.heading_sigma_deg)


def runs_of_file(
    path: Path, model: OdometryModel
) -> tuple[MeasuredRuns, tuple[OdometryRun, ...], tuple[str, ...]]:
    """Read a file of measured runs and the logs that it names; return also the readers' notes.

    Raises
    ------
    ConfigError
        With one line for each error of the file.
    LogFormatError, CalibrationError
        If a log cannot be read or holds no odometry.
    """
    measured = toml_source.load(path, MeasuredRuns)
    runs = []
    notes: list[str] = []
    for each in measured.run:
        log = path.parent / each.log
        if not log.exists():
            raise ConfigError(f"{path}: run.log: {log}: no such file or folder")
        recording = read_recording(log, with_sonars=False)
        notes += [f"{each.log}: {note}" for note in recording.notes]
        stamps_ns, rolled = wheels_of(recording, model)
        runs.append(measured_run(each.name or each.log, stamps_ns, rolled, each, measured))
    return measured, tuple(runs), tuple(notes)


def measured_run(
    name: str,
    stamps_ns: NDArray[np.int64],
    rolled: NDArray[np.float64],
    end: MeasuredRun,
    measured: MeasuredRuns,
) -> OdometryRun:
    """Return the run that ended at the measured place."""
    stamps_s = _seconds(stamps_ns - stamps_ns[0])
    heading = math.nan if end.heading_deg is None else math.radians(end.heading_deg)
    return OdometryRun(
        name,
        stamps_s,
        rolled,
        stamps_s[-1:],
        np.array([[end.x_m, end.y_m, heading]]),
        SE2(),
        measured.start_sigma,
    )


def run_of_recording(recording: Recording, model: OdometryModel) -> tuple[OdometryRun, OdometryRun]:
    """Return a recording as a run with all its references, and with those to be fitted.

    Raises
    ------
    CalibrationError
        If it has no reference, no odometry, or too little of both at the same time.
    """
    if recording.reference is None:
        raise CalibrationError(
            f"{recording.name}: no reference poses in it, against which odometry could be "
            "calibrated; with a tape measure use --runs, see docs/calibration.md"
        )
    stamps_ns, rolled = wheels_of(recording, model)
    if is_timeless(stamps_ns) or is_timeless(recording.reference.stamps_ns):
        raise CalibrationError(
            f"{recording.name}: all its odometry or reference has one time, so they cannot be "
            "matched"
        )
    # from the first stamp on: a float64 of the wall time is too coarse for a search in time
    stamps_s = _seconds(stamps_ns - stamps_ns[0])
    reference_s = _seconds(recording.reference.stamps_ns - stamps_ns[0])
    reference = recording.reference.poses.copy()
    if not recording.reference_has_heading:
        reference[:, 2] = math.nan
    inside = (reference_s >= stamps_s[0]) & (reference_s <= stamps_s[-1])
    if np.count_nonzero(inside) < _LEAST:
        raise CalibrationError(
            f"{recording.name}: {np.count_nonzero(inside)} references while there is odometry, at "
            f"least {_LEAST} are needed"
        )
    full = OdometryRun(recording.name, stamps_s, rolled, reference_s[inside], reference[inside])
    run = thinned(full, model.travel_m(rolled), SPACING_M)
    if len(run.reference_s) < _LEAST:
        raise CalibrationError(
            f"{recording.name}: the robot drives {float(np.sum(model.travel_m(rolled))):.1f} m, at "
            f"least {_LEAST * SPACING_M:g} m are needed"
        )
    return full, run


def wheels_of(
    recording: Recording, model: OdometryModel
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return times (n + 1,) [ns] and turns of the wheels of a recording, as `OdometryRun` has them.

    From counts where there are any, else from odometry poses, else from velocities; these two are
    taken to be made with the nominal drive. What a gyro has turned of the odometry is taken off.

    Raises
    ------
    CalibrationError
        If there is none of them, or counts of two wheels belong to a drive with other wheels.
    """
    if len(recording.wheel_ticks) > 1:
        if len(model.nominal.wheel_names) != _COUNTED or model.nominal.joint_names:
            raise CalibrationError(
                f"{recording.name}: holds counts of two wheels, but the robot is of the kind "
                f'"{model.nominal.kind}"; name a differential one by --robot'
            )
        ticks = recording.wheel_ticks
        turns = np.diff(ticks[:, 1:], axis=0) * math.tau / model.nominal.counts_per_revolution
        return ticks[:, 0], turns
    if recording.odometry is not None and len(recording.odometry.stamps_ns) > 1:
        moves = _moves(recording.odometry)
        if len(recording.gyro_turns_rad):
            moves[:, 1] -= np.diff(recording.gyro_turns_rad)
        return recording.odometry.stamps_ns, model.rolled(moves)
    if len(recording.twists) > 1:
        stamps_ns = recording.twist_stamps_ns
        spans_s = 1e-9 * np.diff(stamps_ns)
        moves = recording.twists[:-1] * spans_s[:, None]
        return stamps_ns, model.rolled(np.column_stack([moves, np.zeros(len(moves))]))
    raise CalibrationError(f"{recording.name}: no counts, odometry poses or velocities in it")


def _moves(odometry: Trajectory) -> NDArray[np.float64]:
    """Return way, turn and way sideways between poses, (n, 3) [m, rad, m].

    See `odometry_estimate.arc_between`.
    """
    x, y, theta = odometry.poses.T
    turn = np.remainder(np.diff(theta) + math.pi, math.tau) - math.pi
    direction = theta[:-1] + 0.5 * turn
    chord = np.diff(x) * np.cos(direction) + np.diff(y) * np.sin(direction)
    across = np.diff(y) * np.cos(direction) - np.diff(x) * np.sin(direction)
    shrink = np.sinc(0.5 * turn / math.pi)
    return np.stack([chord / shrink, turn, across / shrink], axis=1)


def _seconds(stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return times as [s]."""
    return np.asarray(1e-9 * stamps_ns)
