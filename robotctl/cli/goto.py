"""`robotctl goto` and `robotctl explore`: let a running robot drive by plan."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Annotated

import typer

from robotctl.cli.driving import Instance, drive

if TYPE_CHECKING:
    from robotctl.app.supervision.remote import RemoteRobot
    from robotctl.messages.control import NavigationState

STOPPED = "stopped: the robot stands, in mode HOLD"


def goto(
    x: Annotated[
        str,
        typer.Argument(
            metavar="X|PLACE", help="In the world, in metres; or a place of its topological map."
        ),
    ],
    y: Annotated[float | None, typer.Argument(metavar="Y", help="In the world, in metres.")] = None,
    heading: Annotated[
        float | None, typer.Argument(metavar="DEG", help="Heading at the end; default: any.")
    ] = None,
    start: Annotated[
        str,
        typer.Option(
            "--from", metavar="PLACE", help="Where it is now; default: it recognises that."
        ),
    ] = "",
    instance: Instance = "",
) -> None:
    """Let a robot that runs on this computer, and is armed, drive to a place by plan.

    Status 0: it is there. 1: it gave up, or somebody else took it over. Ctrl-C lets it stand.
    """
    drive(instance, _errand(x, y, heading, start), lambda state: state.goal_reached, STOPPED)


def _errand(
    x: str, y: float | None, heading: float | None, start: str
) -> Callable[[RemoteRobot], Iterator[NavigationState]]:
    """Return how to ask a robot to drive to a named place, or to coordinates.

    Raises
    ------
    BadParameter
        If they are no numbers, or have a place to start from.
    """
    if y is None:
        return lambda robot: robot.goto_place(x, start)
    if start:
        raise typer.BadParameter(f"--from {start}: only on the way to a PLACE, found {x} {y:g}")
    try:
        numbers = float(x), y
    except ValueError as error:
        raise typer.BadParameter(f"X is a number where there is a Y, found {x}") from error
    if not all(map(math.isfinite, (*numbers, heading or 0.0))):
        raise typer.BadParameter("a place is finite numbers")
    heading_rad = None if heading is None else math.radians(heading)
    return lambda robot: robot.goto(*numbers, heading_rad)


def explore(instance: Instance = "") -> None:
    """Let a robot that runs on this computer, and is armed, explore until its map is complete.

    Status 0: it is complete, as far as the robot can reach. 1: it gave up, or somebody else took it
    over. Ctrl-C lets it stand.
    """
    drive(instance, lambda robot: robot.explore(), lambda state: state.goal_reached, STOPPED)
