"""The configuration patch of a camera's calibration: tables of `[camera]` of a robot's file."""

from __future__ import annotations

from robotctl.config.patch import Value, as_toml, round_figures
from robotctl.estimation.camera.calibration.mount import FOCAL, KEYS
from robotctl.model.sensors.camera import CameraIntrinsics
from robotctl.workbench.camera.calibrate import CameraCalibrateResult

_DIGITS = {"_m": 5, "_deg": 4, "_px": 3}
_WITHIN = 1.96
_WORDS = {
    "calibration_sigma_deg": "of the pitch, for the intervals of ranges",
    "height_sigma": "of the height, as a share of it",
}


def patch_values(result: CameraCalibrateResult) -> dict[str, dict[str, Value]]:
    """Return table, key and value of all that was found, rounded."""
    tables: dict[str, dict[str, Value]] = {}
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


def intervals(result: CameraCalibrateResult) -> dict[str, float]:
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


def patch_text(result: CameraCalibrateResult) -> str:
    """Return the TOML, with comments on its origin and quality."""
    options = result.options
    lens = result.lens
    sources = [] if lens is None else [f"{len(lens.rms_px)} pictures"]
    sources += [file.name for file in (options.floor, options.markers, options.points) if file]
    comments = [
        (
            f"Camera of {result.config.robot.name}, by robotctl camera calibrate from "
            f"{', '.join(sources)}"
        ),
        "Replace the keys in the robot's file with these.",
    ]
    comments += [
        f"at {each.range_m:g} m: {1e3 * each.calibration_m:.0f} mm from the calibration, "
        f"{1e3 * each.pixel_m:.0f} mm from {options.noise.sigma_px:g} px (standard deviations)"
        for each in result.expected
    ]
    halves = intervals(result)

    def words(table: str, key: str) -> str:
        half = halves.get(f"{table}.{key}")
        return _WORDS.get(key, "") if half is None else f"95 %: ± {half:.2g}"

    return as_toml(patch_values(result), comments, words)


def _lens_values(lens: CameraIntrinsics) -> dict[str, Value]:
    """Return the keys of `[camera.intrinsics]`."""
    values: dict[str, Value] = {"width_px": lens.width_px, "height_px": lens.height_px}
    for key in ("fx_px", "fy_px", "cx_px", "cy_px"):
        values[key] = _rounded(key, getattr(lens, key))
    values["distortion"] = [round(each, 6) for each in lens.distortion]
    return values


def _rounded(key: str, value: float) -> float:
    """Return a value rounded to a hundredth of the achievable accuracy, by the unit in its key."""
    return round(value, _DIGITS["_" + key.rpartition("_")[2]]) + 0.0
