"""`robotctl characterise`: what a robot's sonars or lidar are like."""

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
from robotctl.workbench.sensors.options import CharacteriseOptions

if TYPE_CHECKING:
    from robotctl.workbench.sensors.characterise import Characterisation

ABORTED = 1
WORSE = 3


@takes_options
def characterise(
    ctx: typer.Context,
    options: CharacteriseOptions,
    plot: Annotated[
        Path | None, typer.Option(help="Plot errors and echoes: .png, .svg or .pdf.")
    ] = None,
    out: PatchFile = None,
) -> None:
    """Find noise, outliers and limits of sonars or lidar, with 95 % intervals.

    Without --log the simulated robot drives a round. Status 0: found. 1: the data are too few, or
    or readings without poses. 3: with the new settings readings say less about the place than with
    the present ones, no patch. 2: bad input.
    """
    if options.log is not None:
        refuse_unused(ctx, "with --log", "seed")
    else:
        refuse_unused(ctx, "without --log", "max_range_m", "time_unit")
    check_files(out, plot=plot)
    # They take a second or more to load.
    from robotctl.compiled import COMPILING, cache_is_cold  # noqa: PLC0415
    from robotctl.workbench.sensors.characterise import characterise as run  # noqa: PLC0415

    progress = plain_console(stderr=True)
    if cache_is_cold():
        progress.print(COMPILING, soft_wrap=True)
    try:
        result = run(options, lambda line: progress.print(f"{line} …"))
    except CalibrationError as error:
        progress.print(f"robotctl: {error}", soft_wrap=True)
        sys.exit(ABORTED)
    sys.exit(_show(result, plot, out))


def _show(result: Characterisation, plot: Path | None, out: Path | None) -> int:
    """Show all; return the exit status."""
    from robotctl.cli.characterise.plot import save_plot  # noqa: PLC0415
    from robotctl.cli.characterise.view import fit_table, patch_table, words  # noqa: PLC0415
    from robotctl.workbench.sensors.patch import patch_text, patch_values  # noqa: PLC0415

    console = plain_console()
    console.print(fit_table(result))
    for line in words(result):
        console.print(line, soft_wrap=True)
    if plot is not None:
        write_file(plot, lambda file: save_plot(result, file))
        print(f"plot: {plot}")
    if result.told_after < result.told_before:
        print("With the new settings readings say less about the place; keep the present ones.")
        if out is not None:
            print(f"{out} was not written.")
        return WORSE
    console.print(patch_table(result))
    give_patch(patch_text(result), out)
    advise_keeping(result.options.robot, patch_values(result))
    return 0
