"""`robotctl sim`: the whole robot in simulation, from the bus to the score."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotctl.app.simulation.sim_options import OWN_BUS, SimOptions
from robotctl.cli.arguments import Web, refuse_unused, web_settings
from robotctl.cli.compile import compile_missing
from robotctl.cli.console import plain_console
from robotctl.cli.files import check_files, write_file
from robotctl.cli.live.keys import Keys
from robotctl.cli.logs.report import check_page, write_report
from robotctl.cli.options import takes_options
from robotctl.cli.sim_task import SimTask, own_folder
from robotctl.config.arguments import DEFAULT_ROBOT, Overrides, RobotFile
from robotctl.drivers.mavlink.listening import busy_links
from robotctl.errors import ConfigError, DiskError
from robotctl.estimation.localisers import LOCALISERS
from robotctl.runtime.open_files import need_open_files

if TYPE_CHECKING:
    from robotctl.app.scoring.score import Report

NOT_COMPLETED = 3
OWN_PAGE = "127.0.0.1:8080"
"""Address of the web page, unless the run is headless or the user names one."""


@takes_options
def sim(
    ctx: typer.Context,
    choice: partial[SimOptions],
    task: SimTask,
    robot: RobotFile = DEFAULT_ROBOT,
    report: Annotated[Path | None, typer.Option(help="Write the score here as JSON.")] = None,
    html: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write a page about the run: score, map, figures."),
    ] = None,
    headless: Annotated[bool, typer.Option("--headless", help="No live view.")] = False,
    until_done: Annotated[
        bool,
        typer.Option(
            "--until-done/--stay",
            help="End with the mission, or stay for ground stations until Ctrl-C or the limit.",
        ),
    ] = True,
    lockstep: Annotated[
        bool, typer.Option("--lockstep", help="One process in virtual time: same seed, same run.")
    ] = False,
    web: Web = None,
    overrides: Overrides = (),
) -> None:
    """Drive a mission in simulation and score it.

    Status 0: completed, or ended by Ctrl-C with --stay. 3: not completed, or a fault did not begin:
    it could not, or the run was over before its time. 2: bad input. 4: the disk did not take all.
    130: interrupted before the robot was ready.
    """
    check_files(report)
    record = _checked_record(choice.keywords["record"], html)
    world = choice.keywords["world"]
    task = task.completed(world)
    page = web if web is not None else "" if headless or lockstep else OWN_PAGE
    options = choice(
        robot=robot,
        record=record,
        start=task.pose(),
        mission=task.mission_file(world),
        overrides=(*task.settings(), *web_settings(page), *overrides),
        localisation=task.localisation(),
    )
    options = _on_the_globe(options)
    _refuse_what_has_no_effect(ctx, options, lockstep=lockstep, until_done=until_done)
    compile_missing(simulated=True)
    if lockstep:
        result, stopped = _run_lockstep(options), False
    else:
        result, stopped = _run(options, headless=headless, until_done=until_done)
    _conclude(result, report, html, record, stayed=stopped and not until_done)


def _conclude(
    result: Report, report: Path | None, html: Path | None, record: Path | None, *, stayed: bool
) -> None:
    """Write what was asked for, show the score, and end with its status."""
    from robotctl.cli.live.score_view import score_table  # noqa: PLC0415 - help is quick

    try:
        if report is not None:
            write_file(report, lambda path: path.write_bytes(result.json()))
        if html is not None and record is not None:
            write_report(record, html, json.loads(result.json()))
    finally:
        plain_console().print(score_table(result))
    if not (result.passed or (stayed and not result.failed_faults)):
        sys.exit(NOT_COMPLETED)
    if result.log_trouble:
        raise DiskError(result.log_trouble)


def _checked_record(record: Path | None, html: Path | None) -> Path | None:
    """Return the folder of the record, made where it is missing; a page needs one, too."""
    from robotctl.runtime.storage.log_folder import LogError, make_folder, refusal  # noqa: PLC0415

    if html is not None:
        check_page(html, "--html")
        record = record or own_folder()
    if record is not None:
        make_folder(record)
        if reason := refusal(record):
            raise LogError(reason)
    return record


def _refuse_what_has_no_effect(
    ctx: typer.Context, options: SimOptions, *, lockstep: bool, until_done: bool
) -> None:
    """Refuse options that a run in lockstep, or of a robot without a localiser, has no use for.

    Raises
    ------
    ConfigError
        With the first of them.
    """
    from robotctl.config.robot_file import load_robot  # noqa: PLC0415

    if lockstep and options.bus != OWN_BUS:
        raise ConfigError(
            f"--bus {options.bus}: not allowed with --lockstep, which has its own bus"
        )
    if lockstep and not until_done:
        raise ConfigError("--stay: has no effect with --lockstep: no ground station can reach it")
    if lockstep:
        refuse_unused(ctx, "with --lockstep, whose time is virtual", "hard_real_time", "web")
    settings = options.settings(Path("the mission's own"))
    if load_robot(options.robot, settings).localisation.method == "none":
        on_map = " or ".join(name for name, kind in LOCALISERS.items() if kind.needs_map)
        why = f"without a localiser; add --localiser {on_map}"
        unused = ("map", "sensors", *(["start"] if not options.start else []))
        refuse_unused(ctx, why, *unused)


def _on_the_globe(options: SimOptions) -> SimOptions:
    """Return options that say where the simulated world lies on the globe, unless they do already.

    Stations with a map need it. It is on an island near the equator and the zero meridian, since
    degrees in 32 bits, as dronekit sends them, are off by 3 cm at most there; they would be by
    20 cm in the middle of Europe.
    """
    from robotctl.config.robot_file import load_robot  # noqa: PLC0415

    settings = options.settings(Path("the mission's own"))
    if load_robot(options.robot, settings).mavlink.origin is not None:
        return options
    origin = "mavlink.origin={latitude_deg=0.3365,longitude_deg=6.7273,altitude_m=5.0}"
    return replace(options, overrides=(origin, *options.overrides))


def _run_lockstep(options: SimOptions) -> Report:
    """Run in one process in virtual time, behind a progress bar."""
    from robotctl.app.simulation.lockstep import run_lockstep  # noqa: PLC0415 - numba
    from robotctl.cli.live.lockstep_progress import LockstepProgress  # noqa: PLC0415

    with LockstepProgress(plain_console(stderr=True), options.max_seconds) as progress:
        return run_lockstep(options, progress.say, progress.tell)


def _run(options: SimOptions, *, headless: bool, until_done: bool) -> tuple[Report, bool]:
    """Run the processes behind a live view; return the score, and whether Ctrl-C ended the run."""
    from robotctl.app.simulation.sim import SimRun  # noqa: PLC0415
    from robotctl.app.supervision.signals import StopFlag, on_emergency_signal  # noqa: PLC0415
    from robotctl.cli.live.sim_keys import obey  # noqa: PLC0415
    from robotctl.cli.live.view import make_view  # noqa: PLC0415

    need_open_files()
    stopped = StopFlag()
    run, keys = SimRun(options, stopped), Keys()
    for busy in busy_links(run.config.mavlink.link):
        print(busy, file=sys.stderr)
    print("starting firmware_sim", file=sys.stderr)
    with run, make_view(run, headless=headless, keys=keys.usable) as view, keys:
        on_emergency_signal(run.emergency_stop)
        for progress in run.steps(until_done=until_done):
            obey(keys.pressed(), run, view)
            view.update(progress)
        return run.report(), stopped()
