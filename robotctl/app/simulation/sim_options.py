"""Options of a simulated run, and the simulator's own files, checked."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from firmware_sim.config.config import RobotConfig as SimulatedRobot
from firmware_sim.config.config import load_robot, parse_override
from firmware_sim.errors import SimulationError
from firmware_sim.faults.scenario import Scenario, load_scenario
from robotctl.drivers.can.config import CanConfig
from robotctl.errors import ConfigError, RobotctlError
from robotctl.maps.world import find_world
from robotctl.planning.behave.mission.mission_file import Mission, StartPose


class SimulatorError(RobotctlError):
    """The simulated firmware could not start or has ended."""


@dataclass(frozen=True, slots=True)
class SimOptions:
    """The user's options.

    Parameters
    ----------
    robot, mission, world
        Files; an empty world means the mission's own, one may be a ROS map's yaml file.
    bus
        `simcan[:CHANNEL]`, or the name of a SocketCAN interface; of a robot with several buses
        `simcan[:CHANNEL]` too, or as many interfaces with commas between.
    seed
        Seed of the simulated world.
    max_seconds
        The run ends there as not completed.
    overrides
        `key=value` settings of the robot.
    record
        Directory of record and logs; None: none.
    faults
        Scenario of the faults that befall the robot; None: none.
    localisation
        Settings of the localiser, `key=value`; where they name no map it is the world itself.
    hard_real_time
        Whether simulated time runs on while this computer stalls, as on a robot.
    start
        x, y and perhaps a heading where the robot starts [m, m, deg]; empty: as the mission says.
    people, clutter
        How many people walk about, and how many boxes and cylinders stand about that are on no map.

    Raises
    ------
    ConfigError
        If there can be no such bus.
    """

    robot: Path
    mission: Path
    world: str = ""
    bus: str = "simcan"
    seed: int = 1
    max_seconds: float = 300.0
    overrides: tuple[str, ...] = ()
    record: Path | None = None
    faults: Path | None = None
    localisation: tuple[str, ...] = ()
    hard_real_time: bool = False
    start: tuple[float, ...] = ()
    people: int = 0
    clutter: int = 0

    def __post_init__(self) -> None:
        """Check the bus as the robot's file is checked, also where a run needs none."""
        kind, _, channel = self.bus.partition(":")
        if kind != "simcan" and channel:
            raise ConfigError(
                f"--bus {self.bus}: allowed are simcan, simcan:CHANNEL or a SocketCAN interface "
                "such as vcan0"
            )
        interface, channels = self.channels([""])
        try:
            for each in channels:
                CanConfig(interface=interface, channel=each)
        except ValueError as error:
            raise ConfigError(f"--bus {self.bus}: {error}") from error

    def find_world(self, mission: Mission) -> Path:
        """Return the file of the world: the requested one, otherwise the mission's.

        Raises
        ------
        ConfigError
            If there is none.
        """
        if self.world:
            return find_world(self.world)
        if not mission.world:
            raise ConfigError(
                f'{self.mission}: names no world; add world = "NAME" to it, or give --world'
            )
        return find_world(mission.world, self.mission.parent)

    def start_of(self, mission: Mission) -> StartPose:
        """Return where the robot starts."""
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


def bus_names(robot: Path) -> tuple[str, ...]:
    """Return the names of the buses that a robot's file lists; none of a single one, `[can]`.

    What is wrong with the file is said where it is read as a whole.
    """
    try:
        tables = tomllib.loads(robot.read_text(encoding="utf-8-sig")).get("can")
    except (OSError, ValueError, RecursionError):
        return ()
    if not isinstance(tables, list):
        return ()
    return tuple(str(table.get("name", "main")) for table in tables if isinstance(table, dict))


def bus_overrides(options: SimOptions) -> tuple[str, ...]:
    """Return the settings that put a robot on the buses of a simulated run.

    Raises
    ------
    ConfigError
        If `--bus` names another number of interfaces than the robot has buses.
    """
    names = bus_names(options.robot)
    interface, channels = options.channels(names or ("",))
    count = max(len(names), 1)
    if len(channels) != count:
        buses = f"{count} buses ({', '.join(names)})" if names else "one bus"
        raise ConfigError(
            f"--bus {options.bus}: {len(channels)} interfaces found, but {options.robot} has "
            f"{buses}; name one for each, with commas between"
        )
    keys = [f"can.{number}" for number in range(count)] if names else ["can"]
    # A string of JSON is one of TOML too: the path of a socket may hold a quote.
    return tuple(
        setting
        for key, channel in zip(keys, channels, strict=True)
        for setting in (
            f'{key}.interface="{interface}"',
            f"{key}.channel={json.dumps(channel, ensure_ascii=False)}",
        )
    )


def simulation_overrides(overrides: Sequence[str]) -> list[str]:
    """Return those settings of the user that are firmware_sim's.

    The limits and the time-out of commands are, since it holds against the robot what goes beyond
    them, and how often a camera is asked for a picture; where it sits may be wrong in what the
    robot believes.
    """
    shared = ("simulation.", "limits.", "safety.command_timeout_ms", "camera.rate_hz", "imu.")
    return [each for each in overrides if each.startswith(shared)]


def simulated_robot(robot: Path, overrides: Sequence[str] = ()) -> SimulatedRobot:
    """Return the part of a robot's file that firmware_sim reads, after the user's settings.

    Raises
    ------
    SimulatorError
        With one line for each error.
    """
    try:
        settings = dict(parse_override(text) for text in simulation_overrides(overrides))
        return load_robot(robot, settings)
    except SimulationError as error:
        raise SimulatorError(str(error)) from error


def load_faults(options: SimOptions) -> Scenario:
    """Return the scenario of a run, checked against its robot; one without faults by default.

    Raises
    ------
    SimulatorError
        If the file is wrong, or the robot's.
    """
    if options.faults is None:
        return Scenario()
    robot = simulated_robot(options.robot, options.overrides)
    try:
        return load_scenario(options.faults, robot)
    except SimulationError as error:
        raise SimulatorError(str(error)) from error
