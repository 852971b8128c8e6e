"""`robotctl slam`: where did a recorded drive go, and what did it pass."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from robotctl.cli.console import plain_console, say_compiling
from robotctl.cli.files import check_files, give_plot
from robotctl.cli.options import takes_options
from robotctl.cli.progress import progress_bar
from robotctl.cli.slam.output import check_folder, error_words, write_slam
from robotctl.cli.slam.scans import slam_by_scans
from robotctl.words import counted
from robotctl.workbench.slam.options import SlamOptions


@takes_options
def slam(
    options: SlamOptions,
    out: Annotated[
        Path, typer.Option(metavar="FOLDER", help="Write the results into this folder.")
    ],
    plot: Annotated[Path | None, typer.Option(help="Plot to a .png, .svg or .pdf.")] = None,
) -> None:
    """Make a trajectory and a map from a recorded drive, by landmarks or by scans.

    Writes trajectory.tum, online.tum, graph.g2o and report.json, landmarks.csv or map.yaml,
    map.pgm, map.keyframes and closures.csv. By lidar status 0: the map is good. 3: it is doubtful.
    1: it is no map. `robotctl slam edit` changes it by hand.
    """
    check_folder(out)
    check_files(plot=plot)
    console = plain_console(stderr=True)
    if options.sensor is not None:
        slam_by_scans(options, options.sensor, out, plot, console)
    else:
        _slam_by_landmarks(options, out, plot, console)


def _slam_by_landmarks(
    options: SlamOptions, out: Path, plot: Path | None, console: Console
) -> None:
    """Make trajectory and map of landmarks, and write them into a folder."""
    with progress_bar(console, options.log.name, "SLAM") as tell:
        # It takes a second or more, in which nothing would be seen.
        from robotctl.workbench.slam import slam as work  # noqa: PLC0415

        say_compiling(console)
        result = work.slam(options, tell)

    def draw(file: Path) -> None:
        from robotctl.cli.slam.plot import save_plot  # noqa: PLC0415

        save_plot(result, file)

    write_slam(out, console, result.notes, lambda folder: work.write_results(result, folder))
    give_plot(plot, draw)
    print(_sentence(result.report()))


def _sentence(report: dict[str, Any]) -> str:
    """Return the outcome for people."""
    seen, compared = report["sightings"], report["trajectory"]
    parts = [counted(report["landmarks"], "landmark"), counted(seen["used"], "sighting")]
    if seen["unused"]:
        parts.append(f"{seen['unused']} unused")
    parts.append(error_words(compared))
    if compared is not None and "nees_inside_95" in compared:
        parts.append(f"NEES inside 95 % bounds {compared['nees_inside_95']:.1%}")
    parts.append(f"{1e-3 * sum(report['time_ms'].values()):.1f} s")
    return ", ".join(parts)
