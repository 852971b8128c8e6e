"""`robotctl tune`: from measured wheels to gains, with the proof."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotctl.cli.arguments import PatchFile
from robotctl.cli.console import plain_console
from robotctl.cli.files import check_files, give_patch, write_file
from robotctl.cli.options import takes_options
from robotctl.config.patch import as_overrides
from robotctl.workbench.tuning.options import TuneOptions

if TYPE_CHECKING:
    from robotctl.workbench.tuning.tune import TuneResult

ABORTED = 1
WORSE = 3


@takes_options
def tune(
    options: TuneOptions,
    plot: Annotated[
        Path | None, typer.Option(help="Plot the responses: .png, .svg or .pdf.")
    ] = None,
    out: PatchFile = None,
) -> None:
    """Measure the simulated robot's wheels, compute gains, show the responses before and after.

    Status 0: measured, and the new gains are no worse. 1: an experiment was stopped. 3: the new
    gains are worse, no patch. 2: bad input.
    """
    # Loading takes a second, which `--help` need not wait for.
    from robotctl.cli.tune.plot import save_plot  # noqa: PLC0415
    from robotctl.cli.tune.view import response_table, wheel_table  # noqa: PLC0415
    from robotctl.workbench.tuning.track import ExperimentError  # noqa: PLC0415
    from robotctl.workbench.tuning.tune import tune as run_tuning  # noqa: PLC0415

    check_files(out, plot=plot)
    progress = plain_console(stderr=True)
    try:
        result = run_tuning(options, lambda line: progress.print(f"{line} …"))
    except ExperimentError as error:
        progress.print(f"robotctl: {error}", soft_wrap=True)
        sys.exit(ABORTED)
    console = plain_console()
    console.print(response_table(result))
    console.print(wheel_table(result))
    if plot is not None:
        write_file(plot, lambda file: save_plot(result, file))
        print(f"plot: {plot}")
    sys.exit(_conclude(result, out))


def _conclude(result: TuneResult, out: Path | None) -> int:
    """Say whether to use the gains, and how; return the exit status."""
    from robotctl.workbench.tuning.patch import patch_values  # noqa: PLC0415

    if result.objections:
        print("The new gains are worse; keep the present ones:")
        for objection in result.objections:
            print(f"  {objection}")
        if out is not None:
            print(f"{out} was not written.")
        return WORSE
    for shortcoming in result.shortcomings:
        print(f"beware: even with the new gains the robot {shortcoming}")
    options = result.options
    give_patch(result.patch(), out)
    tables = ", ".join(f"[control.{wheel}]" for wheel in result.gains)
    settings = [*options.overrides, *as_overrides(patch_values(result.gains))]
    command = ["robotctl", "sim", "--lockstep", "--robot", str(options.robot)]
    command += [word for setting in settings for word in ("--set", setting)]
    print(
        f"To use it, replace the keys of {tables} in {options.robot}, and run\n"
        f"  robotctl config check {shlex.quote(str(options.robot))}\n"
        f"To try it first:\n  {shlex.join(command)}"
    )
    return 0
