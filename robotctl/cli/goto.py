"""`robotctl goto`: lets a running robot drive to a place."""

from __future__ import annotations

import math
from typing import Annotated

import typer

from robotctl.cli.console import plain_console

NOT_REACHED = 1


def goto(
    x: Annotated[float, typer.Argument(metavar="X", help="In the world, in metres.")],
    y: Annotated[float, typer.Argument(metavar="Y", help="In the world, in metres.")],
    heading: Annotated[
        float | None, typer.Argument(metavar="DEG", help="Heading at the end; default: any.")
    ] = None,
    instance: Annotated[
        str, typer.Option(help="Name of the robot; default: the only one that runs.")
    ] = "",
) -> None:
    """Let a robot that runs on this computer, and is armed, drive to a place by plan.

    Status 0: it is there. 1: it gave up, or somebody else took it over. Ctrl-C lets it stand.
    """
    from robotctl.app.supervision.remote import RefusedError, RemoteRobot  # noqa: PLC0415

    console = plain_console()
    if not all(map(math.isfinite, (x, y, heading or 0.0))):
        raise typer.BadParameter("a place is finite numbers")
    said = ""
    with RemoteRobot(instance) as robot, console.status("") as status:
        try:
            for state in robot.goto(x, y, None if heading is None else math.radians(heading)):
                status.update(state.message)
                words = state.message.strip("0123456789. ")
                if words != said:  # of a countdown the first line
                    said = words
                    console.print(state.message, soft_wrap=True)
        except KeyboardInterrupt:
            robot.hold()
            console.print("stopped: the robot stands, in mode HOLD")
            raise
        except RefusedError as error:
            console.print(f"not reached: {error}", soft_wrap=True)
            raise typer.Exit(NOT_REACHED) from error
    if not state.goal_reached:
        raise typer.Exit(NOT_REACHED)
