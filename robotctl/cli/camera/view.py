"""The results of camera calibration and check as tables for a terminal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich.table import Table

from robotctl.estimation.camera.calibration.intrinsics import KEYS as LENS_KEYS
from robotctl.estimation.camera.calibration.intrinsics import LensFit
from robotctl.estimation.camera.calibration.spread import ALLOWED, Expected
from robotctl.workbench.camera.calibrate import CameraCalibrateResult
from robotctl.workbench.camera.patch import intervals, patch_values

_MOST_POINTS = 24


def values_table(result: CameraCalibrateResult) -> Table:
    """Return what was found, before and after, with the intervals."""
    table = Table(title=f"{result.config.robot.name}: camera", title_justify="left")
    table.add_column("", no_wrap=True)
    for heading in ("before", "after", "95 % interval"):
        table.add_column(heading, justify="right")
    halves = intervals(result)
    for name, values in patch_values(result).items():
        for key, value in values.items():
            half = halves.get(f"{name}.{key}")
            if half is not None and isinstance(value, float):
                before = _before(result, name, key)
                after, ends = f"{value:.5g}", f"{value - half:.5g} to {value + half:.5g}"
                table.add_row(f"{name}.{key}", before, after, ends)
        table.add_section()
    if result.lens is not None:
        for key, value, half in list(
            zip(LENS_KEYS, result.lens.values, result.lens.half_width, strict=True)
        )[4:]:
            ends = f"{value - half:.3g} to {value + half:.3g}"
            table.add_row(f"distortion, {key}", "", f"{value:.3g}", ends)
    return table


def lens_lines(lens: LensFit) -> list[str]:
    """Return how well the lens fits and where in the picture it was seen."""
    kept = lens.rms_px[np.isfinite(lens.rms_px)]
    fields = int(lens.covered.sum())
    lines = [
        (
            f"lens: {len(kept)} pictures, residuals {np.sqrt(np.mean(kept**2)):.2f} px root mean "
            f"square, {kept.max():.2f} px in the worst picture"
        )
    ]
    if not lens.covered.all():
        rows = ["".join("#" if seen else "." for seen in row) for row in lens.covered]
        lines.append(
            f"the board was seen in {fields} of 16 fields of the picture; the lens is less certain "
            "elsewhere:\n  " + "\n  ".join(rows)
        )
    return lines


def points_table(result: CameraCalibrateResult) -> Table | None:
    """Return the points and their residuals; of many only those that disagree; None: none."""
    fit, points = result.fit, result.points
    if fit is None:
        return None
    shown = [
        k for k in range(len(points.names)) if len(points.names) <= _MOST_POINTS or not fit.agree[k]
    ]
    if not shown:
        return None
    table = Table(title="points", title_justify="left")
    for heading in ("", "x m", "y m", "u px", "v px", "off u px", "off v px", ""):
        table.add_column(heading, justify="right" if heading else "left")
    for k in shown:
        (x_m, y_m), (u, v), (du, dv) = points.ground[k], points.pixels[k], fit.residuals_px[k]
        table.add_row(
            points.names[k],
            *(f"{value:.3f}" for value in (x_m, y_m)),
            *(f"{value:.1f}" for value in (u, v)),
            *(f"{value:+.2f}" for value in (du, dv)),
            "" if fit.agree[k] else "left out",
        )
    return table


def expected_table(expected: Sequence[Expected], sigma_px: float) -> Table:
    """Return what places on the floor are expected to err."""
    table = Table(title="expected error of places, standard deviation", title_justify="left")
    for heading in ("at", "from the calibration", f"from {sigma_px:g} px", ""):
        table.add_column(heading, justify="right")
    for each in expected:
        table.add_row(
            f"{each.range_m:g} m",
            f"{1e3 * each.calibration_m:.1f} mm",
            f"{1e3 * each.pixel_m:.1f} mm",
            "" if each.enough else f"over {ALLOWED:.0%}",
        )
    return table


def fit_lines(result: CameraCalibrateResult) -> list[str]:
    """Return how well the mount fits, and the homography."""
    fit = result.fit
    if fit is None:
        return []
    used = fit.residuals_px[fit.agree]
    wrong = [name for name, right in zip(result.points.names, fit.agree, strict=True) if not right]
    lines = [
        (
            f"mount: {len(used)} points, residuals {np.sqrt(np.mean(used**2)):.2f} px root mean "
            f"square, chi2 {fit.chi2:.1f} of {fit.degrees} degrees of freedom"
        )
    ]
    if wrong:
        lines.append(
            f"left out because they contradict the others: {', '.join(wrong)}; measure them again"
        )
    H = fit.camera.homography()
    lines.append("homography K R T of the floor, (x, y, 1) m to (u, v, 1) px without distortion:")
    lines += ["  " + "  ".join(f"{value:12.6g}" for value in row) for row in H]
    return lines


def advice_lines(result: CameraCalibrateResult) -> list[str]:
    """Return whether the points are spread enough, and where more would help."""
    if result.fit is None:
        return []
    advice = result.advice
    if advice is None:
        return [
            f"the points are spread well: within {ALLOWED:.0%} of the distance as far as "
            f"{result.expected[-1].range_m:g} m"
            if result.expected
            else "the camera sees no floor within 3 m"
        ]
    places = ", ".join(f"({x_m:g}, {y_m:g})" for x_m, y_m in advice.markers)
    lines = [
        (
            f"the points are not spread enough for {ALLOWED:.0%} of the distance as far as "
            f"{result.expected[-1].range_m:g} m."
        )
    ]
    if places:
        then = ", ".join(
            f"{1e3 * each.calibration_m:.0f} mm at {each.range_m:g} m" for each in advice.expected
        )
        lines.append(f"  add markers on the floor at about (x, y) = {places} m: then {then}")
    return lines


def _before(result: CameraCalibrateResult, table: str, key: str) -> str:
    """Return a value of the robot's file."""
    camera = result.config.camera
    if camera is None:
        return "-"
    part = camera.intrinsics if table == "camera.intrinsics" else camera.mount
    return f"{getattr(part, key):.5g}"
