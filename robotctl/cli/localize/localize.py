"""`robotctl localize`: where was the robot, by a recorded log and a map."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated, Any

import typer

from robotctl.cli.arguments import MaxRange, Overrides, TimeUnit
from robotctl.cli.console import plain_console
from robotctl.cli.files import check_files, write_file
from robotctl.cli.progress import progress_bar
from robotctl.config.robot_file import RobotConfig, find_file, load_robot
from robotctl.errors import ConfigError
from robotctl.model.geometry.se2 import SE2
from robotctl.words import counted
from robotctl.workbench.localize.options import LocalizeOptions


def localize(
    log: Annotated[
        Path,
        typer.Option(help="CARMEN log, MRCLAM folder, LEGO log, ROS bag, or a recording of ours."),
    ],
    out: Annotated[
        Path | None, typer.Option(help="Write the estimated trajectory here, as TUM file.")
    ] = None,
    map_file: Annotated[
        str, typer.Option("--map", metavar="MAP.yaml", help="ROS map, or a world; for ekf a world.")
    ] = "",
    method: Annotated[
        str, typer.Option(help="mcl: particles and scans. ekf: sightings of landmarks.")
    ] = "mcl",
    search: Annotated[
        bool, typer.Option("--global", help="Start anywhere on the map, not near the reference.")
    ] = False,
    start: Annotated[
        str, typer.Option(metavar="X,Y,DEG", help="Start pose on the map: m, m, deg.")
    ] = "",
    reference: Annotated[
        Path | None,
        typer.Option(help="TUM file, or log with a reference, to compare with instead of its own."),
    ] = None,
    particles: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Maximum number of particles; default: 2000, for a search by area.",
        ),
    ] = None,
    beams: Annotated[
        int | None,
        typer.Option(min=1, help="Beams used of each scan; default: 60, or as --robot says."),
    ] = None,
    scans: Annotated[
        str, typer.Option(help="all, even or odd: by position in the log, from 0.")
    ] = "all",
    odometry_noise: Annotated[
        str,
        typer.Option(
            metavar="SIGMA_TRANS,SIGMA_ROT",
            help="Noise added to the odometry: m after 1 m, rad after 1 m or 1 rad.",
        ),
    ] = "0,0",
    seed: Annotated[int, typer.Option(min=0, help="Seed of everything random.")] = 1,
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
    mrclam_robot: Annotated[
        int | None, typer.Option(min=1, help="Robot of an MRCLAM folder; default: 1.")
    ] = None,
    robot: Annotated[
        str,
        typer.Option(help="Robot whose file describes lidar and sonars; default: built-in values."),
    ] = "",
    overrides: Overrides = None,
    max_range: MaxRange = None,
    time_unit: TimeUnit = None,
) -> None:
    """Localise on a recorded log, and compare with its reference.

    Status 0: done, be the robot lost or not. 2: bad input. With --seeds the files but the report
    are those of the first seed.
    """
    settings = _settings(robot, overrides)
    options = LocalizeOptions(
        log=log,
        map=map_file,
        method=method,
        search=search,
        particles=particles,
        beams=beams,
        scans=scans,
        odometry_noise=_sigmas(odometry_noise),
        seed=seed,
        mrclam_robot=mrclam_robot,
        sensors=None if settings is None else settings.localisation,
        odometry=None if settings is None else settings.odometry,
        max_range_m=max_range,
        time_unit=time_unit,
        start=_start(start),
        reference=reference,
    )
    check_files(out, csv, report, plot=plot)
    console = plain_console(stderr=True)
    with progress_bar(console, log.name, "localising") as tell:
        # It takes a second or more, in which nothing would be seen.
        from robotctl.compiled import COMPILING, cache_is_cold  # noqa: PLC0415
        from robotctl.logs.formats.tum import write_tum  # noqa: PLC0415
        from robotctl.workbench.localize.localize import localize_seeds  # noqa: PLC0415
        from robotctl.workbench.localize.table import write_table  # noqa: PLC0415

        if method == "mcl" and cache_is_cold():
            console.print(COMPILING, soft_wrap=True)
        results = localize_seeds(options, seeds, tell)
    first = results[0]
    for note in (*first.recording.notes, *first.run.notes):
        console.print(f"note: {note}", soft_wrap=True)
    if out is not None:
        write_file(out, lambda file: write_tum(file, first.trajectory))
    if csv is not None:
        write_file(csv, lambda file: write_table(file, first.run))
    reports = [{"seed": seed + at, **result.report} for at, result in enumerate(results)]
    if report is not None:
        data = {"seeds": reports} if seeds > 1 else first.report
        text = json.dumps(data, indent=2) + "\n"
        write_file(report, lambda file: file.write_text(text, encoding="utf-8"))
    if plot is not None:
        from robotctl.cli.localize.plot import save_plot  # noqa: PLC0415

        write_file(plot, lambda file: save_plot(first, file))
    if seeds > 1:
        from robotctl.cli.localize.view import seeds_table  # noqa: PLC0415

        plain_console().print(seeds_table(reports))
    else:
        print(_sentence(first.report))


def _settings(robot: str, overrides: list[str] | None) -> RobotConfig | None:
    """Return what the robot's file says of it; None without a robot."""
    if robot:
        return load_robot(find_file(robot), tuple(overrides or ()))
    if overrides:
        raise ConfigError(f"--set {overrides[0]}: needs --robot, whose keys it overrides")
    return None


def _start(text: str) -> SE2 | None:
    """Return the pose of --start; None without one."""
    if not text:
        return None
    try:
        x, y, heading_deg = map(float, text.split(","))
        if not math.isfinite(x + y + heading_deg):
            raise ValueError
    except ValueError:
        raise ConfigError(
            f"--start {text}: three numbers with commas are needed, x [m], y [m] and heading "
            "[deg], e.g. 1.5,-2,90"
        ) from None
    return SE2(x, y, math.remainder(math.radians(heading_deg), math.tau))


def _sigmas(text: str) -> tuple[float, float]:
    """Return the two numbers of --odometry-noise."""
    try:
        trans, rot = map(float, text.split(","))
    except ValueError:
        raise ConfigError(
            f"--odometry-noise {text}: two numbers with a comma are needed, e.g. 0.1,0.05"
        ) from None
    return trans, rot


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
