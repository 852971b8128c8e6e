"""`robotctl calibrate odometry`: wheels and track as they really are, with the proof."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotctl.cli.arguments import PatchFile, refuse_unused
from robotctl.cli.console import plain_console
from robotctl.cli.files import advise_keeping, check_files, give_patch, write_file
from robotctl.cli.options import takes_options
from robotctl.errors import CalibrationError
from robotctl.workbench.odometry.options import OdometryCalibrateOptions

if TYPE_CHECKING:
    from robotctl.workbench.odometry.calibrate_odometry import OdometryCalibrateResult

ABORTED = 1
WORSE = 3

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
    progress = plain_console(stderr=True)
    try:
        result = calibrate_odometry(options, lambda line: progress.print(f"{line} …"))
    except CalibrationError as error:
        progress.print(f"robotctl: {error}", soft_wrap=True)
        sys.exit(ABORTED)
    console = plain_console()
    console.print(drive_table(result))
    for line in reference_lines(result):
        console.print(line)
    if result.checks:
        console.print(check_table(result))
    if plot is not None:
        write_file(plot, lambda file: save_plot(result, file))
        print(f"plot: {plot}")
    sys.exit(_conclude(result, out))


def _conclude(result: OdometryCalibrateResult, out: Path | None) -> int:
    """Say whether to use the values, and how; return the exit status."""
    from robotctl.workbench.odometry.calibrate_patch import patch_text, patch_values  # noqa: PLC0415

    for sentence in (*result.notes, *result.hidden):
        print(sentence)
    if result.objections:
        print("Odometry is worse with the new values; keep the present ones:")
        for objection in result.objections:
            print(f"  {objection}")
        if out is not None:
            print(f"{out} was not written.")
        return WORSE
    give_patch(patch_text(result), out)
    advise_keeping(result.options.robot, patch_values(result))
    return 0
