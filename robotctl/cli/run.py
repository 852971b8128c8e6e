"""`robotctl run`: the stack on a real robot."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer
import zmq

from robotctl.app.config import find_file
from robotctl.app.options import StackOptions
from robotctl.app.pilot import load_mission
from robotctl.app.signals import StopFlag
from robotctl.app.stack import Stack
from robotctl.cli.arguments import Overrides, RobotName
from robotctl.runtime.messages import Notice
from robotctl.runtime.topics import Endpoints, Subscriber, endpoint_directory

_POLL_S = 0.2


def run(
    robot: RobotName = "diff_drive",
    mission: Annotated[
        str, typer.Option(help="Mission file or name for mode AUTO; default: none.")
    ] = "",
    record: Annotated[
        Path | None, typer.Option(help="Folder for the record of the control loop.")
    ] = None,
    overrides: Overrides = None,
) -> None:
    """Run control, navigation and telemetry until Ctrl-C; arm from a ground station."""
    path = find_file(robot)
    mission_path = find_file(mission, "missions") if mission else None
    start = load_mission(mission_path).start.pose if mission_path else None
    options = StackOptions(
        instance="robot",
        robot=str(path.resolve()),
        overrides=tuple(overrides or ()),
        mission=str(mission_path.resolve()) if mission_path else "",
        x_m=start.x_m if start else 0.0,
        y_m=start.y_m if start else 0.0,
        theta_rad=start.theta_rad if start else 0.0,
        record=str(record.resolve()) if record else "",
    )
    config = options.load()
    stopped = StopFlag()
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    endpoints = Endpoints(endpoint_directory(options.instance))
    notices = Subscriber[Notice](context, endpoints.published, Notice)
    print(f"{config.robot.name} on {config.can.interface}:{config.can.channel}, Ctrl-C ends")
    for link in config.mavlink.link:
        print(f"MAVLink: {link.url}")
    stack = Stack(options)
    try:
        while not stopped():
            for line in [notice.text for notice in notices.receive()] + stack.watch():
                print(line, flush=True)
            time.sleep(_POLL_S)
    finally:
        stack.close()
        context.destroy(linger=0)
