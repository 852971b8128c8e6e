"""The configuration patch of a calibration: `[drive]` and `[odometry]` of a robot's file."""

from __future__ import annotations

import math
from collections.abc import Mapping

from robotctl.app.calibrate_odometry import CalibrateResult
from robotctl.app.tune_patch import round_figures
from robotctl.estimation.odometry_calibration import Interval

_WORDS = {
    "wheel_radius_m": "mean of both wheels, or of the driven one",
    "wheel_radius_ratio": "right over left",
    "track_width_m": "as it acts while turning",
    "wheelbase_m": "as it acts while turning",
    "steering_offset_rad": "of the wheel where the servo says 0",
    "e_m_per_sqrt_m": "of the distance, after 1 m",
    "f_rad_per_sqrt_m": "of the heading, after 1 m",
    "g_rad_per_sqrt_rad": "of the heading, after a turn by 1 rad",
}


def patch_values(result: CalibrateResult) -> dict[str, dict[str, float]]:
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


def patch_overrides(result: CalibrateResult) -> list[str]:
    """Return the same values as `--set` takes them."""
    return [
        f"{table}.{key}={value!r}"
        for table, values in patch_values(result).items()
        for key, value in values.items()
    ]


def patch_text(result: CalibrateResult) -> str:
    """Return the TOML, under comments that say where it comes from."""
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
        "Put these keys in place of those in the robot's file.",
        "",
        *errors,
        *result.hidden,
    ]
    lines = [f"# {comment}".rstrip() for comment in comments]
    for table, values in patch_values(result).items():
        lines += ["", f"[{table}]", *_lines(result, values)]
    return "\n".join(lines) + "\n"


def _lines(result: CalibrateResult, values: Mapping[str, float]) -> list[str]:
    """Return the lines of one table, with intervals."""
    found = result.found
    lines = []
    for key, value in values.items():
        if key in found.model.keys:
            low, high = _ends(found.interval(key))
        else:
            fold = found.noise_fold[found.noise.__slots__.index(key)]
            low, high = value / fold, value * fold
        words = f"{_WORDS[key]}; 95 %: {low:.5g} to {high:.5g}"
        lines.append(f"{f'{key} = {value!r}':<32}# {words}")
    return lines


def _ends(interval: Interval | None) -> tuple[float, float]:
    """Return the ends of an interval."""
    return (interval.low, interval.high) if interval is not None else (math.nan, math.nan)


def _rounded(key: str, value: float) -> float:
    """Return a value of `[drive]` to a hundredth of what any calibration tells."""
    return round(value, 6) if key.endswith("_rad") else round_figures(value, 6)
