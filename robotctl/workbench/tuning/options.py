"""Options of `robotctl tune`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer

from robotctl.config.arguments import DEFAULT_ROBOT, Overrides, RobotFile


@dataclass(frozen=True, slots=True)
class TuneOptions:
    """Which wheels of which simulated robot to tune, and how."""

    robot: RobotFile = DEFAULT_ROBOT
    method: Annotated[
        str,
        typer.Option(help="step: steps of the duty, SIMC gains. relay: oscillation, Ku and Tu."),
    ] = "step"
    wheel: Annotated[str, typer.Option(help="Wheels to tune: left, right, drive or all.")] = "all"
    overrides: Overrides = ()
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulated world.")] = 1
