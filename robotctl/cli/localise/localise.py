"""`robotctl localise`: where was the robot, by a recorded log and a map."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from robotctl.cli.console import plain_console, say_compiling
from robotctl.cli.files import check_files, write_file
from robotctl.cli.options import takes_options
from robotctl.cli.progress import progress_bar
from robotctl.config.arguments import Overrides
from robotctl.config.robot_file import RobotConfig, find_file, load_robot
from robotctl.errors import ConfigError
from robotctl.logs.formats.tum import write_tum
from robotctl.words import counted
from robotctl.workbench.localise.options import LocaliseOptions
from robotctl.workbench.localise.table import write_table

if TYPE_CHECKING:
    from robotctl.workbench.localise.localise import Localised


@takes_options
def localise(
    choice: partial[LocaliseOptions],
    out: Annotated[
        Path | None, typer.Option(help="Write the estimated trajectory here, as TUM file.")
    ] = None,
    seeds: Annotated[
        int, typer.Option(min=1, help="Number of runs, with seeds from --seed on; one table.")
    ] = 1,
    csv: Annotated[
        Path | None,
        typer.Option(help="Write pose, status, covariance and errors of each estimate here."),
    ] = None,
    report: Annotated[
        Path | None, typer.Option(help="Write errors against the log's reference here, as JSON.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Plot to a .png, .svg or .pdf.")] = None,
    robot: Annotated[
        str,
        typer.Option(help="Robot whose file describes lidar and sonars; default: built-in values."),
    ] = "",
    overrides: Overrides = (),
) -> None:
    """Localise on a recorded log, and compare with its reference.

    Status 0: done, be the robot lost or not. 2: bad input. With --seeds the files but the report
    are those of the first seed.
    """
    settings = _settings(robot, overrides)
    options = choice(
        sensors=None if settings is None else settings.localisation,
        odometry=None if settings is None else settings.odometry,
    )
    check_files(out, csv, report, plot=plot)
    results = _localised(options, seeds)
    first = results[0]
    if out is not None:
        write_file(out, lambda file: write_tum(file, first.trajectory))
    if csv is not None:
        write_file(csv, lambda file: write_table(file, first.run))
    reports = [{"seed": options.seed + at, **each.report} for at, each in enumerate(results)]
    if report is not None:
        data = {"seeds": reports} if seeds > 1 else first.report
        text = json.dumps(data, indent=2) + "\n"
        write_file(report, lambda file: file.write_text(text, encoding="utf-8"))
    if plot is not None:
        from robotctl.cli.localise.plot import save_plot  # noqa: PLC0415

        write_file(plot, lambda file: save_plot(first, file))
    if seeds > 1:
        from robotctl.cli.localise.view import seeds_table  # noqa: PLC0415

        plain_console().print(seeds_table(reports))
    else:
        print(_sentence(first.report))


def _localised(options: LocaliseOptions, seeds: int) -> list[Localised]:
    """Return the results of all seeds, behind a progress bar."""
    console = plain_console(stderr=True)
    with progress_bar(console, options.log.name, "localising") as tell:
        # It takes a second or more, in which nothing would be seen.
        from robotctl.workbench.localise.localise import localise_seeds  # noqa: PLC0415

        if options.method == "mcl":
            say_compiling(console)
        results = localise_seeds(options, seeds, tell)
    for note in (*results[0].recording.notes, *results[0].run.notes):
        console.print(f"note: {note}", soft_wrap=True)
    return results


def _settings(robot: str, overrides: tuple[str, ...]) -> RobotConfig | None:
    """Return what the robot's file says of it; None without a robot."""
    if robot:
        return load_robot(find_file(robot), overrides)
    if overrides:
        raise ConfigError(f"--set {overrides[0]}: needs --robot, whose keys it overrides")
    return None


def _sentence(report: dict[str, Any]) -> str:
    """Return the outcome for people."""
    ape, heading, shares = report["ape"], report["heading_rmse_rad"], report["shares"]
    parts = [counted(report["updates"], "update")]
    if ape["rmse_m"] is not None:
        parts.append(f"position error {ape['rmse_m']:.3f} m rms, at most {ape['max_m']:.3f} m")
    else:
        parts.append("no reference to compare with")
    if heading is not None:
        parts.append(f"heading {heading:.4f} rad rms")
    words = f"localised {shares['localised']:.1%}, searching {shares['searching']:.1%}"
    if shares["lost"]:
        words += f", lost {shares['lost']:.1%}"
    if shares["confidently_wrong"] is not None:
        words += f", confidently wrong {shares['confidently_wrong']:.1%}"
    parts.append(words)
    if report["echoes_on_map"] is not None:
        parts.append(f"{report['echoes_on_map']:.0%} of the echoes on the map")
    parts.append("lost at the end" if report["lost"] else "place known at the end")
    return ", ".join(parts)
