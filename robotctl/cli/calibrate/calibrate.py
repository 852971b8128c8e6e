"""`robotctl calibrate odometry`: wheels and track as they really are, with the proof."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotctl.cli.arguments import PatchFile, refuse_unused
from robotctl.cli.calibration import calibrated, refuse_patch
from robotctl.cli.console import plain_console
from robotctl.cli.files import advise_keeping, check_files, give_patch, give_plot
from robotctl.cli.options import takes_options
from robotctl.workbench.odometry.options import OdometryCalibrateOptions

if TYPE_CHECKING:
    from robotctl.workbench.odometry.calibrate_odometry import OdometryCalibrateResult


app = typer.Typer(no_args_is_help=True, help="Calibrate the robot from drives and recordings.")


@app.callback()
def calibrate() -> None:
    """Calibrate the robot from drives and recordings."""


@app.command()
@takes_options
def odometry(
    ctx: typer.Context,
    options: OdometryCalibrateOptions,
    plot: Annotated[
        Path | None, typer.Option(help="Plot before and after: .png, .svg or .pdf.")
    ] = None,
    out: PatchFile = None,
) -> None:
    """Find wheel sizes, track width or wheelbase, and noise of odometry, with 95 % intervals.

    Without --log and --runs the simulated robot drives squares in both directions. Status 0: found,
    and dead reckoning is better with it. 1: a drive failed, or the data are too few. 3: it is
    worse, no patch. 2: bad input.
    """
    if options.log is not None or options.runs is not None:
        refuse_unused(ctx, "with recorded drives", "seed")
    if options.log is None:
        refuse_unused(ctx, "without --log", "mrclam_robot", "time_unit")
    # Loading takes a second, which `--help` need not wait for.
    from robotctl.cli.calibrate.plot import save_plot  # noqa: PLC0415
    from robotctl.cli.calibrate.view import (  # noqa: PLC0415
        check_table,
        drive_table,
        reference_lines,
    )
    from robotctl.workbench.odometry.calibrate_odometry import calibrate_odometry  # noqa: PLC0415

    check_files(out, plot=plot)
    result = calibrated(calibrate_odometry, options)
    console = plain_console()
    console.print(drive_table(result))
    for line in reference_lines(result):
        console.print(line)
    if result.checks:
        console.print(check_table(result))
    give_plot(plot, lambda file: save_plot(result, file))
    sys.exit(_conclude(result, out))


def _conclude(result: OdometryCalibrateResult, out: Path | None) -> int:
    """Say whether to use the values, and how; return the exit status."""
    from robotctl.workbench.odometry.calibrate_patch import patch_text, patch_values  # noqa: PLC0415

    for sentence in (*result.notes, *result.hidden):
        print(sentence)
    if result.objections:
        sentence = "Odometry is worse with the new values; keep the present ones:"
        return refuse_patch(sentence, result.objections, out)
    give_patch(patch_text(result), out)
    advise_keeping(result.options.robot, patch_values(result))
    return 0
