"""Options of a simulated run."""

from __future__ import annotations

from argparse import ArgumentTypeError
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal

import typer

from robotctl.errors import ConfigError

if TYPE_CHECKING:
    from firmware_sim.world.manner import Manner
    from robotctl.planning.behave.mission.mission_file import Mission, StartPose

OWN_BUS: Final = "simcan"
"""The default bus."""
STUBBORN: Final = "stubborn"
"""The default manner of people."""


def _scenario(name: str) -> Path:
    """Return the file of a fault scenario; raises ConfigError if there is none."""
    from robotctl.config.robot_file import find_file  # noqa: PLC0415 - help is quick

    return find_file(name, "scenarios")


@dataclass(frozen=True, slots=True)
class SimOptions:
    """Settings of a simulated run.

    Raises
    ------
    ConfigError
        If there can be no such bus, no such manner, or nobody for it.
    """

    robot: Path
    mission: Path
    world: Annotated[
        str,
        typer.Option(help="World file or name, or a ROS map.yaml; default: the mission's."),
    ] = ""
    bus: Annotated[
        str,
        typer.Option(help="simcan, simcan:CHANNEL, or a SocketCAN interface such as vcan0."),
    ] = OWN_BUS
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulated world.")] = 1
    max_seconds: Annotated[
        float, typer.Option(min=1.0, help="Time limit from arming on, in the robot's time.")
    ] = 300.0
    record: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Folder for the control record and the CAN log."),
    ] = None
    faults: Annotated[
        Path | None,
        typer.Option(
            parser=_scenario,
            metavar="NAME",
            help="Fault scenario, file or name; status 3 if a fault did not begin.",
        ),
    ] = None
    people: Annotated[
        int, typer.Option(min=0, help="How many people walk about, as --manner says.")
    ] = 0
    manner: Annotated[
        str,
        typer.Option(
            metavar="NAME,...",
            help="How they walk: stubborn (they evade nobody), evades, wanders, runs, or mixed.",
        ),
    ] = STUBBORN
    clutter: Annotated[
        int,
        typer.Option(min=0, help="How many boxes and cylinders stand about that are on no map."),
    ] = 0
    hard_real_time: Annotated[
        bool,
        typer.Option(
            "--hard-real-time",
            help="Simulated time runs on when this computer stalls; default: it pauses.",
        ),
    ] = False
    start: tuple[float, ...] = ()
    """x, y and perhaps a heading where the robot starts [m, m, deg]; empty: as the mission says."""
    overrides: tuple[str, ...] = ()
    """`key=value` settings of the robot."""
    localisation: tuple[str, ...] = ()
    """`key=value` settings of the localiser; where they name no map it is the world itself."""

    def __post_init__(self) -> None:
        """Check manners, and the bus as the robot's file is checked, also where it is unused."""
        if self.manners != (STUBBORN,) and not self.people:  # which parses them
            raise ConfigError(f"--manner {self.manner}: nobody walks about; add --people N")
        kind, _, channel = self.bus.partition(":")
        if kind != "simcan" and channel:
            raise ConfigError(
                f"--bus {self.bus}: allowed are simcan, simcan:CHANNEL or a SocketCAN interface "
                "such as vcan0"
            )
        from robotctl.drivers.can.config import CanConfig  # noqa: PLC0415 - help is quick

        interface, channels = self.channels([""])
        try:
            for each in channels:
                CanConfig(interface=interface, channel=each)
        except ValueError as error:
            raise ConfigError(f"--bus {self.bus}: {error}") from error

    @property
    def manners(self) -> tuple[Manner, ...]:
        """Manners in which the people walk, in turn.

        Raises
        ------
        ConfigError
            If there is no such manner.
        """
        from firmware_sim.world.manner import parse_manners  # noqa: PLC0415 - help is quick

        try:
            return parse_manners(self.manner)
        except ArgumentTypeError as error:
            raise ConfigError(f"--manner {error}") from error

    def find_world(self, mission: Mission) -> Path:
        """Return the file of the world: the requested one, otherwise the mission's.

        Raises
        ------
        ConfigError
            If there is none.
        """
        from robotctl.maps.world import find_world  # noqa: PLC0415 - help is quick

        if self.world:
            return find_world(self.world)
        if not mission.world:
            raise ConfigError(
                f'{self.mission}: names no world; add world = "NAME" to it, or give --world'
            )
        return find_world(mission.world, self.mission.parent)

    def start_of(self, mission: Mission) -> StartPose:
        """Return where the robot starts."""
        from robotctl.planning.behave.mission.mission_file import StartPose  # noqa: PLC0415

        return StartPose(*self.start) if self.start else mission.start

    def settings(self, world: Path) -> tuple[str, ...]:
        """Return all settings of the robot in a world, the user's own last."""
        if not self.localisation:
            return self.overrides
        return (f'localisation.map="{world}"', *self.localisation, *self.overrides)

    def channels(
        self, names: Sequence[str]
    ) -> tuple[Literal["socketcan", "simcan"], tuple[str, ...]]:
        """Return python-can's interface, and the channels of buses of these names.

        Simulated buses but the first have their name behind that of the channel.
        """
        kind, _, channel = self.bus.partition(":")
        if kind == "simcan":
            first = channel or "simcan0"
            return "simcan", (first, *(f"{first}-{name}" for name in names[1:]))
        return "socketcan", tuple(kind.split(","))
