"""The configuration patch of a calibration: `[drive]` and `[odometry]` of a robot's file."""

from __future__ import annotations

import math

from robotctl.config.patch import as_toml, round_figures
from robotctl.estimation.odometry.calibration import Interval
from robotctl.workbench.odometry.calibrate_odometry import OdometryCalibrateResult

_WORDS = {
    "wheel_radius_m": "mean of all wheels, or of the driven one",
    "wheel_radius_ratio": "right over left",
    "track_width_m": "effective while turning",
    "wheelbase_m": "effective while turning",
    "slip_factor": "effective over geometric track width",
    "wheel_distance_m": "effective while turning",
    "steering_offset_rad": "of the wheel at servo angle 0",
    "e_m_per_sqrt_m": "of the distance, after 1 m",
    "f_rad_per_sqrt_m": "of the heading, after 1 m",
    "g_rad_per_sqrt_rad": "of the heading, after a turn by 1 rad",
}


def patch_values(result: OdometryCalibrateResult) -> dict[str, dict[str, float]]:
    """Return table, key and value of all that the data show, rounded."""
    found = result.found
    drive = {
        key: _rounded(key, float(getattr(found.drive, key)))
        for key in found.model.keys
        if found.identified(key)
    }
    noise = {
        key: round_figures(getattr(found.noise, key), 2)
        for key, fold in zip(found.noise.__slots__, found.noise_fold, strict=True)
        if math.isfinite(fold)
    }
    return {name: table for name, table in (("drive", drive), ("odometry", noise)) if table}


def patch_text(result: OdometryCalibrateResult) -> str:
    """Return the TOML, with comments on its origin."""
    options = result.options
    words = [f"--robot {options.robot.name}"]
    words += [f"--log {options.log.name}"] if options.log is not None else []
    words += [f"--runs {options.runs.name}"] if options.runs is not None else []
    words += [f"--seed {options.seed}"] if options.log is None and options.runs is None else []
    words += [f"--set {override}" for override in options.overrides]
    command = f"robotctl calibrate odometry {' '.join(words)}"
    errors = [
        f"{check.what}: {check.before_m:.4f} m, then {check.after_m:.4f} m"
        for check in result.checks
    ]
    comments = [
        f"Odometry of {result.config.robot.name}, from: {command}",
        "Replace the keys in the robot's file with these.",
        "",
        *errors,
        *result.hidden,
    ]
    tables = patch_values(result)

    def said(table: str, key: str) -> str:
        low, high = _interval(result, key, tables[table][key])
        return f"{_WORDS[key]}; 95 %: {low:.5g} to {high:.5g}"

    return as_toml(tables, comments, said)


def _interval(result: OdometryCalibrateResult, key: str, value: float) -> tuple[float, float]:
    """Return the 95 % interval of a value."""
    found = result.found
    if key in found.model.keys:
        return _ends(found.interval(key))
    fold = found.noise_fold[found.noise.__slots__.index(key)]
    return value / fold, value * fold


def _ends(interval: Interval | None) -> tuple[float, float]:
    """Return the ends of an interval."""
    return (interval.low, interval.high) if interval is not None else (math.nan, math.nan)


def _rounded(key: str, value: float) -> float:
    """Return a value of `[drive]` rounded to a hundredth of the achievable accuracy."""
    return round(value, 6) if key.endswith("_rad") else round_figures(value, 6)
