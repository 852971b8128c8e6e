"""`robotctl run`: the stack on a real robot."""

from __future__ import annotations

import math
import os
import sys
import time
import uuid
from pathlib import Path
from typing import Annotated

import typer
import zmq

from native_kernels.cache import cache_of
from robotctl.app.processes.navigator import load_mission
from robotctl.app.processes.progress import StoredProgress, resumed, state_directory
from robotctl.app.supervision.exit_log import ExitLog
from robotctl.app.supervision.service import ServiceNotifier
from robotctl.app.supervision.signals import StopFlag, on_emergency_signal
from robotctl.app.supervision.stack import Stack
from robotctl.app.supervision.supervisor import POLL_S, Supervisor
from robotctl.cli.arguments import Web, web_settings
from robotctl.cli.compile import compile_missing
from robotctl.cli.live.keys import AFTERWARDS, HINT, Keys
from robotctl.cli.live.voice import Voice
from robotctl.cli.options import takes_options
from robotctl.cli.web import words
from robotctl.config.arguments import DEFAULT_ROBOT, Overrides, RobotFile, mission_file
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig
from robotctl.drivers.mavlink.listening import busy_links
from robotctl.messages.control import ControlState, NavigationState, Notice
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.mission.mission_file import Mission
from robotctl.runtime.ipc.topics import Endpoints, Subscriber, endpoint_directory
from robotctl.runtime.open_files import need_open_files
from robotctl.runtime.storage.log_folder import refusal
from robotctl.web.links import read_links


def place_of(saved: StoredProgress, items: int) -> str:
    """Return where a run resumes: the mission item, and the pose."""
    item = f"with item {saved.item + 1} of {items}"
    if saved.item == items:
        item = "after the last item of its mission" if items else "without a mission"
    heading_deg = math.degrees(saved.theta_rad)
    return f"{item} at x {saved.x_m:.2f} m, y {saved.y_m:.2f} m, {heading_deg:.0f} deg"


def _resumed(options: StackOptions, items: int) -> StackOptions:
    """Return the options to resume the interrupted run, whose mission has so many items."""
    options, saved, notes = resumed(options, items)
    if saved.mission_file:
        items = len(load_mission(Path(saved.mission_file)).item)
    for note in notes:
        print(note)
    print(f"resuming {place_of(saved, items)}: the robot must stand there")
    return options


def _tell_connections(config: RobotConfig) -> None:
    """Print where others can connect, and what is in the way."""
    buses = ", ".join(f"{bus.interface}:{bus.channel}" for bus in config.buses)
    print(f"{config.robot.name} on {buses}, Ctrl-C ends", flush=True)
    for link in config.mavlink.link:
        print(f"MAVLink: {link.url}", flush=True)
    for busy in busy_links(config.mavlink.link):
        print(busy, flush=True)


@takes_options
def run(
    robot: RobotFile = DEFAULT_ROBOT,
    mission: Annotated[
        Path | None,
        typer.Option(
            parser=mission_file,
            metavar="NAME",
            help="Mission file or name for mode AUTO; default: none.",
        ),
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Folder for the record of the control loop."),
    ] = None,
    resume: Annotated[
        bool,
        typer.Option(
            "--resume", help="Continue with the pose and mission item of the previous run."
        ),
    ] = False,
    web: Web = None,
    overrides: Overrides = (),
) -> None:
    """Run control, navigation and telemetry until Ctrl-C; arm from a ground station.

    Space, e, and `pkill -USR1 robotctl` stop the robot at once. Processes that end are restarted,
    disarmed.
    """
    loaded = load_mission(mission) if mission else None
    options = _options(robot, mission, loaded, record, (*web_settings(web or ""), *overrides))
    config = options.load()
    if resume:
        options = _resumed(options, len(loaded.item) if loaded else 0)
    need_open_files()
    if not cache_of("robotctl").is_complete():
        compile_missing(simulated=False)
    log = ExitLog(record.resolve()) if record else None
    if record and (reason := refusal(record)):
        print(f"{reason}; the robot drives without logs")
    _supervise(options, config, log)


def _options(
    robot: Path,
    mission: Path | None,
    loaded: Mission | None,
    record: Path | None,
    overrides: tuple[str, ...],
) -> StackOptions:
    """Return how to start the processes; the robot stands where its mission begins, or at 0."""
    start = loaded.start.pose if loaded else SE2(0.0, 0.0, 0.0)
    state = state_directory(os.environ).resolve()
    return StackOptions(
        instance="robot",
        robot=str(robot.resolve()),
        overrides=overrides,
        mission=str(mission.resolve()) if mission else "",
        x_m=start.x_m,
        y_m=start.y_m,
        theta_rad=start.theta_rad,
        record=str(record.resolve()) if record else "",
        flights=str(record.resolve() if record else state / "flights"),
        state=str(state),
        run=uuid.uuid4().hex,
    )


def _supervise(options: StackOptions, config: RobotConfig, log: ExitLog | None) -> None:
    """Run the processes until Ctrl-C or a shutdown, and say what happens."""
    stopped = StopFlag()
    notifier = ServiceNotifier(os.environ)
    _tell_connections(config)
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    endpoints = Endpoints(endpoint_directory(options.instance))
    messages = Subscriber[ControlState | NavigationState | Notice](
        context, endpoints.published, ControlState | NavigationState | Notice
    )
    stack = Stack(options)
    on_emergency_signal(stack.emergency_stop)
    try:
        with Voice() as voice, Supervisor(stack, notifier, log) as supervisor, Keys() as keys:
            if keys.usable:
                voice.say(f"{HINT}; {AFTERWARDS}")
            has_page = not config.web.enabled
            while not stopped() and not stack.shut_down:
                if not has_page and (links := read_links(endpoints.web_links)) is not None:
                    has_page = True
                    # What is no terminal may be a log, where no token belongs.
                    voice.say(words(links) if sys.stdout.isatty() else f"web page: {links.address}")
                if keys.emergency():
                    stack.emergency_stop()
                for line in supervisor.step(messages.receive(), time.monotonic()):
                    voice.say(line)
                time.sleep(POLL_S)
            # Where the CAN adapter goes systemd ends the service at once: why it stopped is new.
            for line in supervisor.last_words(messages.receive()):
                voice.say(line)
    finally:
        context.destroy(linger=0)
