"""Options of `robotctl calibrate odometry`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from robotctl.config.arguments import DEFAULT_ROBOT, Overrides, RobotFile, TimeUnit


@dataclass(frozen=True, slots=True)
class OdometryCalibrateOptions:
    """Drives to calibrate from; without `log` and `runs` the simulated robot drives."""

    robot: RobotFile = DEFAULT_ROBOT
    overrides: Overrides = ()
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulated drives.")] = 1
    log: Annotated[
        Path | None,
        typer.Option(help="Log with reference poses: CARMEN, MRCLAM, LEGO, ROS bag or our own."),
    ] = None
    mrclam_robot: Annotated[int | None, typer.Option(help="Robot of an MRCLAM folder.")] = None
    runs: Annotated[
        Path | None, typer.Option(help="Drives measured by tape, see docs/calibration.md.")
    ] = None
    time_unit: TimeUnit = None
