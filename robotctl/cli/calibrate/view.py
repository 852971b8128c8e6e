"""The result of a calibration as tables for a terminal."""

from __future__ import annotations

import math

import numpy as np
from rich.table import Table

from robotctl.words import counted
from robotctl.workbench.odometry.calibrate_odometry import OdometryCalibrateResult
from robotctl.workbench.odometry.calibrate_patch import patch_values

_NOT_SHOWN = "not determined by these data"


def drive_table(result: OdometryCalibrateResult) -> Table:
    """Return the drive before and after, with the intervals."""
    found = result.found
    table = Table(
        title=f"{result.config.robot.name}: {counted(len(result.runs), 'drive')}, "
        f"{counted(found.references, 'reference')}",
        title_justify="left",
    )
    table.add_column("", no_wrap=True)
    for heading in ("before", "after", "95 % interval"):
        table.add_column(heading, justify="right")
    for key in found.model.keys:
        interval = found.interval(key)
        before = f"{getattr(found.model.nominal, key):.5g}"
        if interval is None:
            table.add_row(key, before, "as before", _NOT_SHOWN)
        else:
            ends = f"{interval.low:.5g} to {interval.high:.5g}"
            table.add_row(key, before, f"{interval.value:.5g}", ends)
    drive = found.model.nominal
    wheels = zip(drive.wheel_names, drive.wheel_radii_m, found.wheel_diameters(), strict=False)
    for name, radius_m, interval in wheels:
        ends = f"{interval.low:.5g} to {interval.high:.5g}"
        before = f"{2.0 * radius_m:.5g}"
        table.add_row(f"diameter, {name} wheel, m", before, f"{interval.value:.5g}", ends)
    table.add_section()
    _noise_rows(table, result)
    return table


def _noise_rows(table: Table, result: OdometryCalibrateResult) -> None:
    """Add the noises."""
    found, shown = result.found, patch_values(result).get("odometry", {})
    for key, fold in zip(found.noise.__slots__, found.noise_fold, strict=True):
        before = f"{getattr(result.config.odometry, key):.2g}"
        if key in shown:
            value = shown[key]
            ends = f"{value / fold:.2g} to {value * fold:.2g}"
            table.add_row(key, before, f"{value:.2g}", ends)
        else:
            table.add_row(key, before, "as before", _NOT_SHOWN)


def reference_lines(result: OdometryCalibrateResult) -> list[str]:
    """Return what the halves say, what was found of the reference, and the factors for poses."""
    found = result.found
    lines = [
        f"the {name} half alone: "
        + ", ".join(f"{key} {getattr(half.drive, key):.5g}" for key in found.model.keys)
        for name, half in zip(("first", "second"), result.halves, strict=False)
    ]
    if not found.reference.follows_base:
        x, y = (
            f"{1000 * value:.0f} ± {1000 * width:.0f} mm"
            for value, width in zip(found.lever_m, found.lever_half_width_m, strict=True)
        )
        lines.append(f"the reference tracks a point {x} ahead and {y} to the left of base,")
        lines.append(
            f"  {1000 * found.delay_s:.0f} ± {1000 * found.delay_half_width_s:.0f} ms late; "
            f"its own noise: {1000 * found.reference.sigma_m:.1f} mm, "
            f"{1000 * found.reference.sigma_s:.0f} ms"
        )
    probe = np.array([[1.0, 0.0, 0.0], [1.0, 0.2, 0.0]])
    straight, bent = found.model.moves(found.change, found.model.rolled(probe))
    lines.append(
        f"as factors for odometry poses: distance × {straight[0]:.4f}, rotation × "
        f"{(bent[1] - straight[1]) / 0.2:.4f}, and {math.degrees(straight[1]):+.3f}° a metre"
    )
    if found.outliers:
        lines.append(f"outliers: {counted(found.outliers, 'component')} of the references")
    return lines


def check_table(result: OdometryCalibrateResult) -> Table:
    """Return the errors before and after."""
    table = Table(title="odometry errors", title_justify="left")
    for heading in ("", "before", "after", "ratio"):
        table.add_column(heading, justify="left" if not heading else "right")
    for check in result.checks:
        ratio = check.after_m / check.before_m if check.before_m > 0.0 else math.inf
        table.add_row(
            check.what, f"{check.before_m:.4f} m", f"{check.after_m:.4f} m", f"{ratio:.2f}"
        )
    return table
