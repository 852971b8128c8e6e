"""The configuration patch of a camera's calibration: tables of `[camera]` of a robot's file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

from robotctl.app.camera_calibrate import CalibrateResult
from robotctl.app.tune_patch import round_figures
from robotctl.estimation.camera_mount import FOCAL, KEYS
from robotctl.model.camera import CameraIntrinsics

Values: TypeAlias = dict[str, int | float | list[float]]

_DIGITS = {"_m": 5, "_deg": 4, "_px": 3}
_WITHIN = 1.96
_WORDS = {
    "calibration_sigma_deg": "of the pitch, for the intervals of ranges",
    "height_sigma": "of the height, as a share of it",
}


def patch_values(result: CalibrateResult) -> dict[str, Values]:
    """Return table, key and value of all that was found, rounded."""
    tables: dict[str, Values] = {}
    fit = result.fit
    if result.lens is not None:
        tables["camera.intrinsics"] = _lens_values(result.lens.intrinsics)
    elif fit is not None and FOCAL in fit.keys:
        tables["camera.intrinsics"] = _lens_values(fit.intrinsics)
    if fit is not None:
        tables["camera.mount"] = {key: _rounded(key, getattr(fit.mount, key)) for key in KEYS}
        tables["ground_camera"] = {
            "calibration_sigma_deg": round_figures(fit.sigma["pitch_deg"], 2),
            "height_sigma": round_figures(fit.sigma["z_m"] / fit.mount.z_m, 2),
        }
    return tables


def patch_overrides(result: CalibrateResult) -> list[str]:
    """Return the same values as `--set` takes them."""
    return [
        f"{table}.{key}={value}"
        for table, values in patch_values(result).items()
        for key, value in values.items()
    ]


def intervals(result: CalibrateResult) -> dict[str, float]:
    """Return half of the 95 % interval of each number that was found, by `table.key`."""
    found = {}
    if result.lens is not None:
        keys = ("fx_px", "fy_px", "cx_px", "cy_px")
        for key, half in zip(keys, result.lens.half_width, strict=False):
            found[f"camera.intrinsics.{key}"] = float(half)
    if result.fit is not None:
        for key, sigma in result.fit.sigma.items():
            if key == FOCAL:
                found |= {f"camera.intrinsics.f{axis}_px": _WITHIN * sigma for axis in "xy"}
            else:
                found[f"camera.mount.{key}"] = _WITHIN * sigma
    return found


def patch_text(result: CalibrateResult) -> str:
    """Return the TOML, under comments that say where it comes from and how good it is."""
    options = result.options
    sources = [f"{len(result.lens_pictures)} pictures"] if result.lens is not None else []
    sources += [file.name for file in (options.floor, options.markers, options.points) if file]
    comments = [
        (
            f"Camera of {result.config.robot.name}, by robotctl camera calibrate from "
            f"{', '.join(sources)}"
        ),
        "Put these keys in place of those in the robot's file.",
    ]
    comments += [
        f"at {each.range_m:g} m: {1e3 * each.calibration_m:.0f} mm from the calibration, "
        f"{1e3 * each.pixel_m:.0f} mm from {options.noise.sigma_px:g} px (standard deviations)"
        for each in result.expected
    ]
    lines = [f"# {comment}" for comment in comments]
    halves = intervals(result)
    for table, values in patch_values(result).items():
        lines += ["", f"[{table}]", *_lines(table, values, halves)]
    return "\n".join(lines) + "\n"


def _lines(table: str, values: Values, halves: Mapping[str, float]) -> list[str]:
    """Return the lines of one table, with intervals."""
    lines = []
    for key, value in values.items():
        half = halves.get(f"{table}.{key}")
        words = _WORDS.get(key, "") if half is None else f"95 %: ± {half:.2g}"
        text = f"{key} = {value}"
        lines.append(f"{text:<32}# {words}" if words else text)
    return lines


def _lens_values(lens: CameraIntrinsics) -> Values:
    """Return the keys of `[camera.intrinsics]`."""
    values: Values = {"width_px": lens.width_px, "height_px": lens.height_px}
    for key in ("fx_px", "fy_px", "cx_px", "cy_px"):
        values[key] = _rounded(key, getattr(lens, key))
    values["distortion"] = [round(each, 6) for each in lens.distortion]
    return values


def _rounded(key: str, value: float) -> float:
    """Return a value to a hundredth of what any calibration tells, by the unit in its key."""
    return round(value, _DIGITS["_" + key.rpartition("_")[2]]) + 0.0
