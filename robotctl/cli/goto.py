"""`robotctl goto` and `robotctl explore`: let a running robot drive by plan."""

from __future__ import annotations

import math
from typing import Annotated

import typer

from robotctl.cli.driving import Instance, drive

STOPPED = "stopped: the robot stands, in mode HOLD"


def goto(
    x: Annotated[float, typer.Argument(metavar="X", help="In the world, in metres.")],
    y: Annotated[float, typer.Argument(metavar="Y", help="In the world, in metres.")],
    heading: Annotated[
        float | None, typer.Argument(metavar="DEG", help="Heading at the end; default: any.")
    ] = None,
    instance: Instance = "",
) -> None:
    """Let a robot that runs on this computer, and is armed, drive to a place by plan.

    Status 0: it is there. 1: it gave up, or somebody else took it over. Ctrl-C lets it stand.
    """
    if not all(map(math.isfinite, (x, y, heading or 0.0))):
        raise typer.BadParameter("a place is finite numbers")
    heading_rad = None if heading is None else math.radians(heading)
    drive(
        instance,
        lambda robot: robot.goto(x, y, heading_rad),
        lambda state: state.goal_reached,
        STOPPED,
    )


def explore(instance: Instance = "") -> None:
    """Let a robot that runs on this computer, and is armed, explore until its map is complete.

    Status 0: it is complete, as far as the robot can reach. 1: it gave up, or somebody else took it
    over. Ctrl-C lets it stand.
    """
    drive(instance, lambda robot: robot.explore(), lambda state: state.goal_reached, STOPPED)
