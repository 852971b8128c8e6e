"""`robotctl characterise`: what a robot's sonars or lidar are like."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotctl.cli.arguments import PatchFile, refuse_unused
from robotctl.cli.calibration import calibrated, refuse_patch
from robotctl.cli.console import plain_console, say_compiling
from robotctl.cli.files import advise_keeping, check_files, give_patch, give_plot
from robotctl.cli.options import takes_options
from robotctl.workbench.sensors.options import CharacteriseOptions

if TYPE_CHECKING:
    from robotctl.workbench.sensors.characterise import Characterisation


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
    from robotctl.workbench.sensors.characterise import characterise as run  # noqa: PLC0415

    progress = plain_console(stderr=True)
    say_compiling(progress)
    result = calibrated(run, options)
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
    give_plot(plot, lambda file: save_plot(result, file))
    if result.told_after < result.told_before:
        sentence = "With the new settings readings say less about the place; keep the present ones."
        return refuse_patch(sentence, (), out)
    console.print(patch_table(result))
    give_patch(patch_text(result), out)
    advise_keeping(result.options.robot, patch_values(result))
    return 0
