"""`robotctl camera check`: how far the camera is off at places that are known."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from robotctl.cli.console import plain_console
from robotctl.cli.files import check_files, write_file
from robotctl.cli.options import takes_options
from robotctl.errors import CalibrationError
from robotctl.workbench.camera.options import CheckOptions

if TYPE_CHECKING:
    from robotctl.workbench.camera.check import CheckResult

ABORTED = 1
OFF = 3


@takes_options
def check(
    options: CheckOptions,
    plot: Annotated[Path | None, typer.Option(help="Plot the errors: .png, .svg or .pdf.")] = None,
) -> None:
    """Compare markers at known places with the camera's estimates.

    Use others than those of the calibration. Status 0: as good as the noise allows. 3: it is off.
    1: no marker is seen. 2: bad input.
    """
    from robotctl.cli.camera.check_plot import save_plot  # noqa: PLC0415
    from robotctl.workbench.camera.check import check_camera  # noqa: PLC0415

    check_files(plot=plot)
    try:
        result = check_camera(options)
    except CalibrationError as error:
        print(f"robotctl: {error}", file=sys.stderr)
        sys.exit(ABORTED)
    console = plain_console()
    console.print(_points_table(result))
    console.print(_bands_table(result))
    if plot is not None:
        write_file(plot, lambda file: save_plot(result, file))
        print(f"plot: {plot}")
    for doubt in result.doubts:
        print(doubt)
    if result.doubts:
        print("The calibration is off: calibrate again, or measure the places again.")
        sys.exit(OFF)
    print(
        f"The camera is as good as {options.sigma_px:g} px and {options.sigma_mm:g} mm let expect."
    )


def _points_table(result: CheckResult) -> Table:
    """Return the error of each point."""
    table = Table(title="estimated minus measured", title_justify="left")
    for heading in ("", "x m", "y m", "distance m", "radial mm", "lateral mm", "σ mm", "chi2"):
        table.add_column(heading, justify="right" if heading else "left")
    errors = result.errors
    chi2 = errors.chi2
    for k, name in enumerate(result.points.names):
        place = (f"{value:.3f}" for value in (*result.points.ground[k], errors.range_m[k]))
        if math.isnan(errors.told[k, 0]):
            table.add_row(name, *place, "not on", "the floor")
            continue
        radial, lateral = 1e3 * errors.off_m[k]
        sigma_mm = 1e3 * math.sqrt(errors.P[k, 0, 0] + errors.P[k, 1, 1])
        off = (f"{radial:+.1f}", f"{lateral:+.1f}", f"{sigma_mm:.1f}", f"{chi2[k]:.1f}")
        table.add_row(name, *place, *off)
    return table


def _bands_table(result: CheckResult) -> Table:
    """Return the errors by distance."""
    table = Table(title="by distance", title_justify="left")
    heads = ("m", "points", "bias radial mm", "lateral mm", "rmse mm", "expected mm", "chi2", "of")
    for heading in heads:
        table.add_column(heading, justify="right")
    for band in result.bands:
        radial, lateral = (1e3 * value for value in band.bias_m)
        table.add_row(
            f"{band.low_m:g} to {band.high_m:g}",
            str(band.count),
            f"{radial:+.1f}",
            f"{lateral:+.1f}",
            f"{1e3 * band.rmse_m:.1f}",
            f"{1e3 * band.expected_m:.1f}",
            f"{band.chi2:.1f}",
            str(2 * band.count),
        )
    return table
