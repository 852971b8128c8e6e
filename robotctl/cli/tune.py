"""`robotctl tune`: from measured wheels to gains, with the proof."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from robotctl.app.config import find_file
from robotctl.app.tune import TuneOptions, TuneResult
from robotctl.app.tune import tune as run_tuning
from robotctl.app.tune_patch import patch_overrides
from robotctl.app.tune_track import ExperimentError
from robotctl.cli.arguments import Overrides, RobotName
from robotctl.cli.tune_plot import check_plot, save_plot
from robotctl.cli.tune_view import response_table, wheel_table
from robotctl.errors import ConfigError

ABORTED = 1
WORSE = 3


def tune(
    robot: RobotName = "diff_drive",
    method: Annotated[
        str,
        typer.Option(help="step: steps of the duty, SIMC gains. relay: oscillation, Ku and Tu."),
    ] = "step",
    wheel: Annotated[str, typer.Option(help="left, right, drive or all.")] = "all",
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulated world.")] = 1,
    plot: Annotated[
        Path | None, typer.Option(help="Draw the responses here: .png, .svg or .pdf.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Write the configuration patch here; else it is shown.")
    ] = None,
    overrides: Overrides = None,
) -> None:
    """Measure the simulated robot's wheels, compute gains, show the responses before and after.

    Status 0: measured, and the new gains are no worse. 1: an experiment was stopped. 3: the new
    gains are worse, no patch. 2: bad input.
    """
    options = TuneOptions(find_file(robot), method, wheel, tuple(overrides or ()), seed)
    if plot is not None:
        check_plot(plot)
    for file in (plot, out):
        check_folder(file)
    progress = Console(stderr=True, highlight=False)
    try:
        result = run_tuning(options, lambda line: progress.print(f"{line} …", markup=False))
    except ExperimentError as error:
        progress.print(f"robotctl: {error}", markup=False, soft_wrap=True)
        sys.exit(ABORTED)
    console = Console()
    console.print(response_table(result))
    console.print(wheel_table(result))
    if plot is not None:
        write_file(plot, lambda file: save_plot(result, file))
        print(f"plot: {plot}")
    sys.exit(_conclude(result, out))


def _conclude(result: TuneResult, out: Path | None) -> int:
    """Say whether to use the gains, and how; return the exit status."""
    if result.objections:
        print("The new gains are worse than the present ones, keep those:")
        for objection in result.objections:
            print(f"  {objection}")
        if out is not None:
            print(f"{out} was not written.")
        return WORSE
    for shortcoming in result.shortcomings:
        print(f"beware: with the new gains, too, the robot {shortcoming}")
    options, patch = result.options, result.patch()
    if out is None:
        print(f"The patch:\n\n{patch}")
    else:
        write_file(out, lambda file: file.write_text(patch, encoding="utf-8"))
        print(f"patch: {out}")
    tables = ", ".join(f"[control.{wheel}]" for wheel in result.gains)
    settings = [*options.overrides, *patch_overrides(result.gains)]
    command = ["robotctl", "sim", "--lockstep", "--robot", str(options.robot)]
    command += [word for setting in settings for word in ("--set", setting)]
    print(
        f"To keep it, put its keys in place of those of {tables} in {options.robot}, and run\n"
        f"  robotctl config check {shlex.quote(str(options.robot))}\n"
        f"To try it first:\n  {shlex.join(command)}"
    )
    return 0


def check_folder(file: Path | None) -> None:
    """Refuse a file in a folder that is not there, before anything is measured."""
    if file is not None and not file.parent.is_dir():
        raise ConfigError(f"{file}: the folder {file.parent} does not exist")
    if file is not None and file.is_dir():
        raise ConfigError(f"{file}: is a folder, a file is needed")


def write_file(file: Path, write: Callable[[Path], object]) -> None:
    """Let `write` write a file.

    Raises
    ------
    ConfigError
        If it cannot be written.
    """
    try:
        write(file)
    except OSError as error:
        raise ConfigError(f"{file}: cannot be written: {error.strerror or error}") from error
