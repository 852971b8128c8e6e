"""Source of the turns that `robotctl places` learns from and recognises."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from robotctl.config.arguments import DEFAULT_ROBOT, Overrides, RobotFile
from robotctl.errors import ConfigError


@dataclass(frozen=True, slots=True)
class PlaceSource:
    """Source of turns, and the robot; exactly one of `log`, `world` and `live` is given.

    Raises
    ------
    ConfigError
        If there is not exactly one source.
    """

    log: Annotated[
        Path | None, typer.Option(help="Recording of a turn on the spot: folder or robot-*.mcap.")
    ] = None
    world: Annotated[
        str, typer.Option(help="World file or name: the simulated robot turns there, in lockstep.")
    ] = ""
    live: Annotated[
        str,
        typer.Option(metavar="ROBOT", help="Listen to a running robot (robot, sim-PID) turning."),
    ] = ""
    at: Annotated[
        str,
        typer.Option(
            metavar="X,Y[,HEADING]",
            help="Pose at the start of the turn, m and deg; in a world also a mark's name.",
        ),
    ] = ""
    robot: RobotFile = DEFAULT_ROBOT
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulated world.")] = 1
    overrides: Overrides = ()

    def __post_init__(self) -> None:
        given = {"--log": self.log is not None, "--world": self.world, "--live": self.live}
        found = [option for option, value in given.items() if value]
        if len(found) != 1:
            raise ConfigError(
                f"one of {', '.join(given)} must give the place of the turn, found "
                f"{' and '.join(found) or 'none'}"
            )
