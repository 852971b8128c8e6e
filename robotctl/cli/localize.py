"""`robotctl localize`: where was the robot, by a recorded log and a map."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from robotctl.app.config import find_file, load_robot
from robotctl.app.localize_options import LocalizeOptions
from robotctl.cli.arguments import MaxRange, Overrides, TimeUnit
from robotctl.cli.console import plain_console
from robotctl.cli.files import check_files, write_file
from robotctl.cli.progress import progress_bar
from robotctl.errors import ConfigError
from robotctl.estimation.localisation_config import LocalisationConfig


def localize(
    log: Annotated[
        Path,
        typer.Option(
            help="CARMEN log, MRCLAM folder, LEGO log, or a recording of ours; gzip or plain."
        ),
    ],
    out: Annotated[Path, typer.Option(help="Write the estimated trajectory here, as TUM file.")],
    map_file: Annotated[
        str, typer.Option("--map", metavar="MAP.yaml", help="ROS map, or a world; for ekf a world.")
    ] = "",
    method: Annotated[
        str, typer.Option(help="mcl: particles and scans. ekf: sightings of landmarks.")
    ] = "mcl",
    search: Annotated[
        bool, typer.Option("--global", help="Start anywhere on the map, not near the reference.")
    ] = False,
    particles: Annotated[
        int | None,
        typer.Option(min=1, help="Most particles: else 2000, with --global 20000."),
    ] = None,
    beams: Annotated[
        int | None, typer.Option(min=1, help="Beams weighed of each scan, else 60 or as --robot.")
    ] = None,
    scans: Annotated[
        str, typer.Option(help="all, even or odd: by their place in the log, from 0.")
    ] = "all",
    odometry_noise: Annotated[
        str,
        typer.Option(
            metavar="SIGMA_TRANS,SIGMA_ROT",
            help="Noise put on the odometry: m after 1 m, rad after 1 m or 1 rad.",
        ),
    ] = "0,0",
    seed: Annotated[int, typer.Option(min=0, help="Of everything random.")] = 1,
    report: Annotated[
        Path | None, typer.Option(help="Write errors against the log's reference here, as JSON.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw it here: .png, .svg or .pdf.")] = None,
    mrclam_robot: Annotated[
        int | None, typer.Option(min=1, help="Robot of a MRCLAM folder, else 1.")
    ] = None,
    robot: Annotated[
        str, typer.Option(help="Robot whose file describes lidar and sonars, else the defaults.")
    ] = "",
    overrides: Overrides = None,
    max_range: MaxRange = None,
    time_unit: TimeUnit = None,
) -> None:
    """Run a filter of the live robot on a recorded log, and compare with the log's reference.

    Status 0: done, be the robot lost or not. 2: bad input.
    """
    options = LocalizeOptions(
        log, map_file, method, search, particles, beams, scans, _sigmas(odometry_noise), seed,
        mrclam_robot, _sensors(robot, overrides), max_range, time_unit,
    )  # fmt: skip
    check_files(out, report, plot=plot)
    console = plain_console(stderr=True)
    with progress_bar(console, log.name, "localising") as tell:
        # It takes a second or more, in which nothing would be seen.
        from robotctl.app.localize import localize as run  # noqa: PLC0415
        from robotctl.estimation.compiled import COMPILING, cache_is_cold  # noqa: PLC0415
        from robotctl.telemetry.tum import write_tum  # noqa: PLC0415

        if method == "mcl" and cache_is_cold():
            console.print(COMPILING, soft_wrap=True)
        result = run(options, tell)
    for note in (*result.recording.notes, *result.run.notes):
        console.print(f"note: {note}", soft_wrap=True)
    write_file(out, lambda file: write_tum(file, result.trajectory))
    if report is not None:
        text = json.dumps(result.report, indent=2) + "\n"
        write_file(report, lambda file: file.write_text(text, encoding="utf-8"))
    if plot is not None:
        from robotctl.cli.localize_plot import save_plot  # noqa: PLC0415

        write_file(plot, lambda file: save_plot(result, file))
    print(_sentence(result.report))


def _sensors(robot: str, overrides: list[str] | None) -> LocalisationConfig | None:
    """Return what the robot's file says of its sensors; None without a robot."""
    if robot:
        return load_robot(find_file(robot), tuple(overrides or ())).localisation
    if overrides:
        raise ConfigError(f"--set {overrides[0]}: needs --robot, whose keys it overrides")
    return None


def _sigmas(text: str) -> tuple[float, float]:
    """Return the two numbers of --odometry-noise."""
    try:
        trans, rot = map(float, text.split(","))
    except ValueError:
        raise ConfigError(
            f"--odometry-noise {text}: two numbers with a comma are needed, e.g. 0.1,0.05"
        ) from None
    return trans, rot


def _sentence(report: dict[str, object]) -> str:
    """Return the outcome for people."""
    ape = report["ape"]
    heading = report["heading_rmse_rad"]
    parts = [f"{report['updates']} updates"]
    if isinstance(ape, dict) and ape["rmse_m"] is not None:
        parts.append(f"position error {ape['rmse_m']:.3f} m rms, at most {ape['max_m']:.3f} m")
    else:
        parts.append("no reference to compare with")
    if isinstance(heading, float):
        parts.append(f"heading {heading:.4f} rad rms")
    parts.append("lost at the end" if report["lost"] else "place known at the end")
    return ", ".join(parts)
