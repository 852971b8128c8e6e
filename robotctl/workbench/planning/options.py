"""Options of `robotctl plan`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer

from robotctl.config.arguments import Overrides, place


def _start(text: str) -> tuple[float, ...]:
    """Return the place of --start; raises ConfigError if it is none."""
    return place("--start", text)


def _goal(text: str) -> tuple[float, ...]:
    """Return the place of --goal; raises ConfigError if it is none."""
    return place("--goal", text)


@dataclass(frozen=True, slots=True)
class PlanOptions:
    """A map, a start and a goal, and how to plan between them."""

    map: Annotated[
        str,
        typer.Option(help="ROS map (.yaml), world, or MovingAI map (.map): there cells are meant."),
    ] = ""
    start: Annotated[
        tuple[float, ...],
        typer.Option(
            parser=_start,
            metavar="X,Y[,DEG]",
            help="Start [m, m, deg]; of a .map: COLUMN,ROW.",
        ),
    ] = ()
    goal: Annotated[
        tuple[float, ...],
        typer.Option(
            parser=_goal,
            metavar="X,Y[,DEG]",
            help="Goal [m, m, deg]; of a .map: COLUMN,ROW.",
        ),
    ] = ()
    planner: Annotated[
        str,
        typer.Option(
            help="astar, dijkstra, hybrid, rrt, rrt-connect or rrtstar; default: as the robot "
            "drives, astar on a .map."
        ),
    ] = ""
    steering: Annotated[
        str,
        typer.Option(
            help="Of the rrt planners: straight, dubins (forwards only) or reeds-shepp. By "
            "default, reeds-shepp for robots that steer and straight for others."
        ),
    ] = ""
    robot: Annotated[
        str, typer.Option(help="Robot file, or the name of one that comes along; for its outline.")
    ] = ""
    overrides: Overrides = ()
    time_limit_s: Annotated[
        float,
        typer.Option("--time-limit", metavar="S", help="The search ends after so many seconds."),
    ] = 10.0
    seed: Annotated[int, typer.Option(help="Of planners that draw random samples.")] = 0
