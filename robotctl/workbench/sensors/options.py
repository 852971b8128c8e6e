"""Options of `robotctl characterise`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import typer

from robotctl.config.arguments import DEFAULT_ROBOT, MaxRange, Overrides, RobotFile, TimeUnit
from robotctl.errors import ConfigError
from robotctl.estimation.sensor_names import LIDAR, SONAR
from robotctl.toml_source import nearest

KINDS: Final = (LIDAR, SONAR)
"""Sensors that can be characterised, as `sources.CALIBRATIONS`."""


@dataclass(frozen=True, slots=True)
class CharacteriseOptions:
    """Readings to characterise a sensor from; without `log` the simulated robot drives."""

    robot: RobotFile = DEFAULT_ROBOT
    overrides: Overrides = ()
    log: Annotated[
        Path | None,
        typer.Option(help="CARMEN log or ROS bag with poses, or our own: a folder of --record."),
    ] = None
    map: Annotated[
        str,
        typer.Option(
            metavar="MAP",
            help="Room of the log: a world, or a ROS map (.yaml); default: made from its even "
            "scans.",
        ),
    ] = ""
    sensor: Annotated[
        str, typer.Option(help="sonar or lidar; default: sonar if there are readings.")
    ] = ""
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulated drive.")] = 1
    max_range_m: MaxRange = None
    time_unit: TimeUnit = None

    def __post_init__(self) -> None:
        if self.sensor not in ("", *KINDS):
            raise ConfigError(
                f"--sensor {self.sensor}: must be {' or '.join(KINDS)}{nearest(self.sensor, KINDS)}"
            )
