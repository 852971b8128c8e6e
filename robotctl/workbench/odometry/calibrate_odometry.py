"""`robotctl calibrate odometry`: from drives with a reference to a drive that is right.

Three sources: the simulated robot's own squares, a real robot's squares measured by tape, or a log
with reference poses; see `docs/calibration.md`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robotctl.config.robot_file import RobotConfig, load_robot
from robotctl.errors import CalibrationError, ConfigError
from robotctl.estimation.odometry.calibration import Calibration, calibrate, widened
from robotctl.estimation.odometry.fit import Reference
from robotctl.estimation.odometry.model import OdometryModel
from robotctl.estimation.odometry.runs import OdometryRun
from robotctl.logs.formats.recorded_log import read_recording
from robotctl.words import counted
from robotctl.workbench.odometry.calibrate_checks import (
    Check,
    check_way,
    held_out_checks,
    mean_gap_m,
    tape_check,
)
from robotctl.workbench.odometry.calibrate_sources import run_of_recording, runs_of_file
from robotctl.workbench.odometry.calibrate_squares import (
    LEFT,
    RIGHT,
    Campaign,
    Progress,
    systematic_error_m,
)
from robotctl.workbench.odometry.options import OdometryCalibrateOptions

_HALF_LEAST = 12


@dataclass(frozen=True, slots=True)
class OdometryCalibrateResult:
    """All that a calibration brought.

    Parameters
    ----------
    options, config
        The options, and the robot before.
    runs
        What was fitted.
    found
        What the fit says.
    halves
        Results of the halves of a log alone; empty for squares and short logs.
    checks
        Errors before and after, the first one decides whether the patch is worth having.
    notes
        Sentences for people.
    """

    options: OdometryCalibrateOptions
    config: RobotConfig
    runs: tuple[OdometryRun, ...]
    found: Calibration
    halves: tuple[Calibration, ...]
    checks: tuple[Check, ...]
    notes: tuple[str, ...]

    @property
    def objections(self) -> list[str]:
        """Remarks on what is worse with the new values than with the present ones."""
        return [
            f"{check.what}: {check.after_m:.4f} m, before {check.before_m:.4f} m"
            for check in self.checks
            if check.after_m > check.before_m
        ]

    @property
    def hidden(self) -> list[str]:
        """Text on what the data do not determine; empty if they determine everything."""
        found = self.found
        words = [
            f"{key} cannot be determined from these data and stays "
            f"{getattr(found.model.nominal, key):g}"
            for key in found.model.keys
            if not found.identified(key)
        ]
        noises = [
            key
            for key, fold in zip(found.noise.__slots__, found.noise_fold, strict=True)
            if not math.isfinite(fold)
        ]
        if noises:
            words.append(f"[odometry] {', '.join(noises)} cannot be determined from these data")
        return words


def calibrate_odometry(
    options: OdometryCalibrateOptions, progress: Progress = lambda _line: None
) -> OdometryCalibrateResult:
    """Gather drives, fit, and compare dead reckoning before and after.

    Raises
    ------
    ConfigError
        If the robot, a setting or a file of runs is wrong.
    LogFormatError
        If a log cannot be read.
    CalibrationError
        If a drive failed or the data are too few.
    SimulatorError
        If the robot cannot be simulated.
    """
    if options.log is not None and options.runs is not None:
        raise ConfigError("--log and --runs: found both, one of them is allowed")
    config = load_robot(options.robot, options.overrides)
    if options.log is not None:
        return _from_log(options, config, options.log, progress)
    if options.runs is not None:
        return _from_tape(options, config, options.runs, progress)
    return _from_simulation(options, config, progress)


def _from_simulation(
    options: OdometryCalibrateOptions, config: RobotConfig, progress: Progress
) -> OdometryCalibrateResult:
    """Let the simulated robot drive before and after."""
    model = OdometryModel(config.drive)
    runs = tuple(Campaign(options.robot, options.overrides, options.seed).drives(model, progress))
    found = _fit(config, runs, _tape(runs), progress)
    settings = tuple(
        f"drive.{key}={getattr(found.drive, key)!r}" for key in model.keys if found.identified(key)
    )
    again = Campaign(options.robot, (*options.overrides, *settings), options.seed)
    check = Check(
        "squares: E_max,syst (greatest mean gap at the end)",
        systematic_error_m(
            {shape: mean_gap_m(model, model.nothing, runs, shape) for shape in (LEFT, RIGHT)}
        ),
        systematic_error_m(again.gaps_m(progress)),
    )
    notes = ("E_max,syst after: driven again with the new values on other floors.",)
    checks = (check, tape_check(found, runs))
    return OdometryCalibrateResult(options, config, runs, found, (), checks, notes)


def _from_tape(
    options: OdometryCalibrateOptions, config: RobotConfig, file: Path, progress: Progress
) -> OdometryCalibrateResult:
    """Fit runs that a user measured."""
    _, runs, read = runs_of_file(file, OdometryModel(config.drive))
    found = _fit(config, runs, _tape(runs), progress)
    notes = (*read, "Before and after are computed on the same runs; drive again to prove it.")
    return OdometryCalibrateResult(
        options, config, runs, found, (), (tape_check(found, runs),), notes
    )


def _from_log(
    options: OdometryCalibrateOptions, config: RobotConfig, log: Path, progress: Progress
) -> OdometryCalibrateResult:
    """Fit a log; test the result of its first half on its second."""
    progress(f"reading {log}")
    model = OdometryModel(config.drive)
    recording = read_recording(
        log, options.mrclam_robot, with_sonars=False, time_unit=options.time_unit
    )
    full, run = run_of_recording(recording, model)
    check_way(run, model)
    reference = Reference()
    found = _fit(config, (run,), reference, progress)
    middle_s = _middle_s(run, model)
    begin_s, end_s = float(run.stamps_s[0]), float(run.stamps_s[-1])
    parts = [run.part(begin_s, middle_s), run.part(middle_s, end_s)]
    halves = tuple(
        _fit(config, (part,), reference, progress)
        for part in parts
        if part is not None and len(part.reference_s) >= _HALF_LEAST
    )
    held_out = full.part(middle_s, end_s)
    checks: tuple[Check, ...] = ()
    if len(halves) == 2 and held_out is not None:
        found = widened(found, halves)
        checks = held_out_checks(halves[0], held_out)
    notes = (
        *recording.notes,
        "Errors after: on the second half, with the values of the first half.",
    )
    return OdometryCalibrateResult(options, config, (run,), found, halves, checks, notes)


def _fit(
    config: RobotConfig, runs: Sequence[OdometryRun], reference: Reference, progress: Progress
) -> Calibration:
    """Fit, or raise an error in the user's terms."""
    progress(f"fitting {counted(sum(len(run.reference_s) for run in runs), 'reference')}")
    try:
        return calibrate(config.drive, runs, reference, config.odometry)
    except ValueError as error:
        raise CalibrationError(str(error)) from error


def _tape(runs: Sequence[OdometryRun]) -> Reference:
    """Return the tape's errors, which are those of placing the robot too."""
    sigma_m, _, sigma_rad = runs[0].start_sigma
    return Reference(sigma_m, sigma_rad, fixed=True, follows_base=True)


def _middle_s(run: OdometryRun, model: OdometryModel) -> float:
    """Return when half of the distance was driven [s]."""
    way_m = np.cumsum(model.travel_m(run.rolled))
    return float(run.stamps_s[1:][np.searchsorted(way_m, 0.5 * way_m[-1])])
