"""`robotctl slam`: where did a recorded drive go, and what did it pass."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, cast

import typer

from robotctl.cli.arguments import TimeUnit
from robotctl.cli.console import plain_console
from robotctl.cli.progress import progress_bar
from robotctl.cli.slam.output import error_words, write_slam
from robotctl.errors import ConfigError
from robotctl.estimation.slam.local_scans.registry import SCAN_SOURCES
from robotctl.words import counted


def slam(
    log: Annotated[
        Path,
        typer.Option(help="MRCLAM folder, another log with sightings or scans, or a graph."),
    ],
    out: Annotated[
        Path, typer.Option(metavar="FOLDER", help="Write the results into this folder.")
    ],
    features: Annotated[str, typer.Option(help="What the map is made of: landmarks.")] = (
        "landmarks"
    ),
    solver: Annotated[
        str,
        typer.Option(
            help="ekf: one Gaussian of robot and map. graph: then the best fit of all. submaps: "
            "local maps, joined, for logs that are graphs."
        ),
    ] = "ekf",
    association: Annotated[
        str,
        typer.Option(
            help="Which landmark is seen: names: as the log says; joint: what fits together best; "
            "nearest: each by itself."
        ),
    ] = "names",
    mrclam_robot: Annotated[
        int | None, typer.Option(min=1, help="Robot of an MRCLAM folder; default: 1.")
    ] = None,
    sensor: Annotated[
        str | None,
        typer.Option(
            help=f"{', '.join(SCAN_SOURCES)}: match what it sees and draw a map, in place of "
            "landmarks."
        ),
    ] = None,
    onto: Annotated[
        Path | None,
        typer.Option(
            "--map",
            metavar="FILE",
            help="Go on with this map of keyframes, made by the same --sensor.",
        ),
    ] = None,
    images: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="With --sensor: the drive's pictures, named by time or listed, to know places by.",
        ),
    ] = None,
    time_unit: TimeUnit = None,
) -> None:
    """Make a trajectory and a map from a recorded drive, by landmarks or by scans.

    Writes trajectory.tum, online.tum, graph.g2o and report.json, landmarks.csv or map.yaml,
    map.pgm, map.keyframes and closures.csv; with the extra `plot` plot.png.
    """
    if sensor is not None and sensor not in SCAN_SOURCES:
        raise ConfigError(f"--sensor {sensor}: unknown; allowed is {', '.join(SCAN_SOURCES)}")
    of_landmarks = (features, solver, association, mrclam_robot)
    if sensor is not None and of_landmarks != ("landmarks", "ekf", "names", None):
        raise ConfigError(
            f"--sensor {sensor}: --features, --solver, --association and --mrclam-robot are for "
            "landmarks, leave them"
        )
    if images is not None and sensor is None:
        raise ConfigError(f"--images: needs --sensor {', '.join(SCAN_SOURCES)}")
    if onto is not None and sensor is None:
        raise ConfigError(f"--map: needs --sensor {', '.join(SCAN_SOURCES)}")
    if not out.parent.is_dir():
        raise ConfigError(f"--out {out}: the folder {out.parent} does not exist")
    if out.exists() and not out.is_dir():
        raise ConfigError(f"--out {out}: is a file, a folder is needed")
    console = plain_console(stderr=True)
    if sensor is not None:
        from robotctl.cli.slam.scans import slam_by_scans  # noqa: PLC0415

        slam_by_scans(log, out, time_unit, console, onto, sensor, images)
        return
    with progress_bar(console, log.name, "SLAM") as tell:
        # It takes a second or more, in which nothing would be seen.
        from robotctl.compiled import COMPILING, cache_is_cold  # noqa: PLC0415
        from robotctl.workbench.slam.slam import (  # noqa: PLC0415
            SlamOptions,
            write_results,
        )
        from robotctl.workbench.slam.slam import slam as run  # noqa: PLC0415

        options = SlamOptions(
            log=log,
            features=features,
            solver=solver,
            association=cast("Any", association),
            mrclam_robot=mrclam_robot,
            time_unit=time_unit,
        )
        if cache_is_cold():
            console.print(COMPILING, soft_wrap=True)
        result = run(options, tell)

    def draw(file: Path) -> None:
        from robotctl.cli.slam.plot import save_plot  # noqa: PLC0415

        save_plot(result, file)

    write_slam(out, console, result.notes, lambda folder: write_results(result, folder), draw)
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
