"""`robotctl sim`: the whole robot in simulation, from the bus to the score."""

from __future__ import annotations

import atexit
import json
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotctl.cli.arguments import (
    Overrides,
    RobotName,
    Web,
    place,
    refuse_unused,
    web_settings,
)
from robotctl.cli.compile import compile_missing
from robotctl.cli.console import plain_console
from robotctl.cli.files import check_files, write_file
from robotctl.cli.live.keys import Keys
from robotctl.cli.logs.report import check_page, write_report
from robotctl.drivers.mavlink.listening import busy_links
from robotctl.errors import ConfigError, DiskError
from robotctl.estimation.localisers import LOCALISERS, LocaliserName, localiser_kind
from robotctl.estimation.sensor_names import SENSORS
from robotctl.runtime.open_files import need_open_files

if TYPE_CHECKING:
    from robotctl.app.simulation.score import Report
    from robotctl.app.simulation.sim_options import SimOptions
    from robotctl.app.supervision.signals import StopFlag

NOT_COMPLETED = 3
ERRAND = "errand"
"""What a robot drives that is told nothing; it has to find out where it is, too."""
PATROL, FLATS = "patrol", ("flat", "flat_lived_in")
"""The default mission, and the worlds with room for it."""
GOAL_WORLD = "flat"
"""Where a goal lies unless the user says."""
OWN_BUS = "simcan"
"""The default bus."""
OWN_PAGE = "127.0.0.1:8080"
"""Address of the web page, unless the run is headless or the user names one."""


def sim(
    ctx: typer.Context,
    robot: RobotName = "diff_drive",
    world: Annotated[
        str,
        typer.Option(help="World file or name, or a ROS map.yaml; default: the mission's."),
    ] = "",
    mission: Annotated[
        str,
        typer.Option(
            help="Mission file or name; default: errand; with --world a straight line, in the flat "
            "patrol."
        ),
    ] = "",
    bus: Annotated[
        str,
        typer.Option(help="simcan, simcan:CHANNEL, or a SocketCAN interface such as vcan0."),
    ] = OWN_BUS,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulated world.")] = 1,
    max_seconds: Annotated[
        float, typer.Option(min=1.0, help="Time limit from arming on, in the robot's time.")
    ] = 300.0,
    report: Annotated[Path | None, typer.Option(help="Write the score here as JSON.")] = None,
    html: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write a page about the run: score, map, figures."),
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Folder for the control record and the CAN log."),
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
    faults: Annotated[
        str,
        typer.Option(help="Fault scenario, file or name; status 3 if a fault did not begin."),
    ] = "",
    localiser: Annotated[
        LocaliserName | None,
        typer.Option(
            help="Localisation method; default: as the robot's file says, mcl for the errand."
        ),
    ] = None,
    goal: Annotated[
        str,
        typer.Option(
            metavar="X,Y[,DEG]|PLACE",
            help="Drive there, instead of a mission: by plan, or with --topological by places.",
        ),
    ] = "",
    topological: Annotated[
        str,
        typer.Option(
            metavar="FILE",
            help="Map of places, of `robotctl topology build`, which the robot recognises.",
        ),
    ] = "",
    people: Annotated[
        int, typer.Option(min=0, help="How many people walk about, who do not evade the robot.")
    ] = 0,
    clutter: Annotated[
        int,
        typer.Option(min=0, help="How many boxes and cylinders stand about that are on no map."),
    ] = 0,
    start: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y[,DEG]",
            help="Where the robot starts; `known`: where mission or world say, the default; "
            "`unknown`: there, and its localiser does not know it, the default for the errand.",
        ),
    ] = None,
    world_map: Annotated[
        str,
        typer.Option(
            "--map", help="Map of the localiser: a world, or a ROS map.yaml; default: the world."
        ),
    ] = "",
    mapping: Annotated[
        bool, typer.Option("--mapping", help="Build a map of what the sensors see.")
    ] = False,
    slam: Annotated[
        bool,
        typer.Option("--slam", help="Know no map: make one, and drive by that."),
    ] = False,
    camera: Annotated[
        bool,
        typer.Option("--camera", help="Use the camera: ranges, obstacles, and their score."),
    ] = False,
    sensors: Annotated[
        str,
        typer.Option(
            metavar="NAME,...",
            help=f"Sensors of the localiser: {', '.join(SENSORS)}; default: as the robot's file "
            "says.",
        ),
    ] = "",
    hard_real_time: Annotated[
        bool,
        typer.Option(
            "--hard-real-time",
            help="Simulated time runs on when this computer stalls; default: it pauses.",
        ),
    ] = False,
    web: Web = None,
    overrides: Overrides = None,
) -> None:
    """Drive a mission in simulation and score it.

    Status 0: completed, or ended by Ctrl-C with --stay. 3: not completed, or a fault did not begin:
    it could not, or the run was over before its time. 2: bad input. 4: the disk did not take all.
    130: interrupted before the robot was ready.
    """
    # Loading takes a second, which `--help` need not wait for.
    from robotctl.app.simulation.sim_options import SimOptions  # noqa: PLC0415
    from robotctl.app.supervision.signals import StopFlag  # noqa: PLC0415
    from robotctl.cli.live.lockstep_progress import LockstepProgress  # noqa: PLC0415
    from robotctl.cli.live.score_view import score_table  # noqa: PLC0415
    from robotctl.config.robot_file import find_file  # noqa: PLC0415

    check_files(report)
    record = _checked_record(record, html)
    if slam and (localiser is not None or world_map or start == "unknown"):
        raise ConfigError("--slam: not allowed with --localiser, --map and --start unknown")
    if not (mission or goal or world or slam):
        mission, localiser = ERRAND, localiser or "mcl"
        start = start or ("unknown" if localiser_kind(localiser).searches_map else None)
    pose = _start(start or "known")
    if goal and mission:
        raise ConfigError("--goal: not allowed with --mission, which says where to drive")
    options = SimOptions(
        robot=find_file(robot),
        mission=_goal(world, pose, goal, topological) if goal else _mission(mission, world),
        start=pose,
        people=people,
        clutter=clutter,
        world=world,
        bus=bus,
        seed=seed,
        max_seconds=max_seconds,
        overrides=(
            *_origin(robot, overrides or ()),
            *(["camera.enabled=true"] if camera else []),
            *_places(topological),
            *web_settings(web if web is not None else "" if headless or lockstep else OWN_PAGE),
            *(overrides or ()),
        ),
        record=record,
        faults=find_file(faults, "scenarios") if faults else None,
        localisation=_localisation(
            "slam" if slam else localiser,
            start == "unknown",
            world_map,
            sensors,
            mapping=mapping or slam,
        ),
        hard_real_time=hard_real_time,
    )
    _refuse_what_has_no_effect(ctx, options, lockstep=lockstep, until_done=until_done)
    compile_missing(simulated=True)
    if lockstep:
        from robotctl.app.simulation.lockstep import run_lockstep  # noqa: PLC0415 - numba

        with LockstepProgress(plain_console(stderr=True), max_seconds) as progress:
            result = run_lockstep(options, progress.say, progress.tell)
        stayed = False
    else:
        need_open_files()
        stopped = StopFlag()
        result = _run(options, stopped, headless=headless, until_done=until_done)
        stayed = stopped() and not until_done
    try:
        _keep(result, report, html, record)
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
        record = record or _own_folder()
    if record is not None:
        make_folder(record)
        if reason := refusal(record):
            raise LogError(reason)
    return record


def _keep(result: Report, report: Path | None, html: Path | None, record: Path | None) -> None:
    """Write the files that were asked for."""
    if report is not None:
        write_file(report, lambda path: path.write_bytes(result.json()))
    if html is not None and record is not None:
        write_report(record, html, json.loads(result.json()))


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
        unused = ("world_map", "sensors", *(["start"] if not options.start else []))
        refuse_unused(ctx, why, *unused)


def _start(start: str) -> tuple[float, ...]:
    """Return where the robot starts; empty: as mission or world say."""
    if start in {"known", "unknown"}:
        return ()
    try:
        return place("--start", start)
    except ConfigError as error:
        raise ConfigError(f"{error}, or known, or unknown") from error


def _mission(name: str, world: str) -> Path:
    """Return the mission's file; where none is asked for, one that fits into the world."""
    from robotctl.config.robot_file import find_file  # noqa: PLC0415
    from robotctl.maps.world import find_world  # noqa: PLC0415

    if name or not world or find_world(world).stem in FLATS:
        return find_file(name or PATROL, "missions")
    from robotctl.app.simulation.room import straight_mission  # noqa: PLC0415

    return _written("straight", straight_mission(find_world(world)))


def _goal(world: str, start: tuple[float, ...], goal: str, topological: str) -> Path:
    """Return the file of a mission of one goal; without a world it is the flat."""
    from robotctl.app.simulation.room import goal_mission, place_mission  # noqa: PLC0415
    from robotctl.maps.world import find_world  # noqa: PLC0415

    room = find_world(world or GOAL_WORLD)
    if topological:
        return _written("goal", place_mission(room, start, goal))
    try:
        there = place("--goal", goal)
    except ConfigError as error:
        raise ConfigError(f"{error}; a place by name needs --topological FILE") from error
    return _written("goal", goal_mission(room, start, there))


def _origin(robot: str, overrides: Sequence[str]) -> list[str]:
    """Return where the simulated world lies on the globe, unless the robot's settings say.

    Stations with a map need it. It is on an island near the equator and the zero meridian, since
    degrees in 32 bits, as dronekit sends them, are off by 3 cm at most there; they would be by
    20 cm in the middle of Europe.
    """
    from robotctl.config.robot_file import find_file, load_robot  # noqa: PLC0415

    if load_robot(find_file(robot), overrides).mavlink.origin is not None:
        return []
    return ["mavlink.origin={latitude_deg=0.3365,longitude_deg=6.7273,altitude_m=5.0}"]


def _places(topological: str) -> list[str]:
    """Return the setting of a map of places."""
    from robotctl.config.robot_file import find_file  # noqa: PLC0415

    if not topological:
        return []
    return [f"navigation.pilot.topology={json.dumps(str(find_file(topological, 'places')))}"]


def _written(name: str, text: str) -> Path:
    """Return a file of this run with a mission."""
    mission = _own_folder() / f"{name}.toml"
    mission.write_text(text, encoding="utf-8")
    return mission


def _own_folder() -> Path:
    """Return a new folder of this run, which goes with it."""
    folder = tempfile.mkdtemp(prefix="robotctl-sim-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def _localisation(
    localiser: str | None, lost: bool, world_map: str, sensors: str, *, mapping: bool
) -> tuple[str, ...]:
    """Return the options of the localiser as settings of the robot."""
    from robotctl.maps.world import find_world  # noqa: PLC0415

    settings = []
    if localiser is not None:
        settings.append(f'localisation.method="{localiser}"')
    if lost:
        settings.append('localisation.start="unknown"')
    if world_map:
        settings.append(f'localisation.map="{find_world(world_map)}"')
    if sensors:
        names = ", ".join(f'"{name.strip()}"' for name in sensors.split(","))
        settings.append(f"localisation.sensors=[{names}]")
    if mapping:
        settings.append("localisation.mapping=true")
    return tuple(settings)


def _run(options: SimOptions, stopped: StopFlag, *, headless: bool, until_done: bool) -> Report:
    """Run the processes behind a live view; Ctrl-C ends the run and still scores it."""
    from robotctl.app.simulation.sim import SimRun  # noqa: PLC0415
    from robotctl.app.supervision.signals import on_emergency_signal  # noqa: PLC0415
    from robotctl.cli.live.sim_keys import obey  # noqa: PLC0415
    from robotctl.cli.live.view import make_view  # noqa: PLC0415

    run, keys = SimRun(options, stopped), Keys()
    for busy in busy_links(run.config.mavlink.link):
        print(busy, file=sys.stderr)
    print("starting firmware_sim", file=sys.stderr)
    with run, make_view(run, headless=headless, keys=keys.usable) as view, keys:
        on_emergency_signal(run.emergency_stop)
        for progress in run.steps(until_done=until_done):
            obey(keys.pressed(), run, view)
            view.update(progress)
        return run.report()
