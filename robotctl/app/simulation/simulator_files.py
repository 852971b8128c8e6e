"""The simulator's part of a robot's settings and files, checked."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Sequence
from pathlib import Path

from firmware_sim.config.config import RobotConfig as SimulatedRobot
from firmware_sim.config.config import load_robot, parse_override
from firmware_sim.errors import SimulationError
from firmware_sim.faults.scenario import Scenario, load_scenario
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.errors import ConfigError, RobotctlError


class SimulatorError(RobotctlError):
    """The simulated firmware could not start or has ended."""


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
