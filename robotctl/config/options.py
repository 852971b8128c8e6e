"""Start options of the processes of one robot, passed as JSON on the command line."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Final

import msgspec

from robotctl.config.robot_file import (
    RobotConfig,
    contradictions,
    load_robot,
    robot_of_json,
    robot_to_json,
)
from robotctl.config_values import with_values
from robotctl.errors import ConfigError
from robotctl.messages.ports import Clock
from robotctl.runtime.clock import RealClock, wall_offset_ns
from robotctl.runtime.simulated_clock import Pacer, SimulatedClock
from robotctl.toml_source import is_utf_8

_MOST_BYTES: Final = 128 * 1024 - 1
"""Maximum size of one argument, by execve(2): 32 pages, the zero byte at its end included."""


class StackOptions(msgspec.Struct, frozen=True):
    """One running robot.

    Attributes
    ----------
    instance
        Name of the robot's sockets; two robots on one computer need two names.
    robot
        The robot's configuration file.
    overrides
        `key=value` settings on top of it.
    mission
        Mission file of mode AUTO; empty: none.
    x_m, y_m, theta_rad
        Pose of `base` in `world` at the start.
    record
        Directory for the record of the control loop and the logs; empty: none.
    flights
        Directory for dumps of the flight recorder after faults; empty: none.
    state
        Directory of state that survives restarts; empty: none.
    run
        Name of this run. A process that restarts within it continues pose and mission item.
    epoch_ns
        Added to CLOCK_MONOTONIC to get the times of all logs [ns]: read once for all processes, so
        that their logs agree, and none jumps when the wall clock is set; 0 in virtual time.
    clock
        File of a simulator's clock for all processes of the robot; empty: the computer's clock.
    config
        Validated file and settings, as JSON; empty: not yet.
    changes
        Parameters that differed from the configuration at the start, by dotted key.
    """

    instance: str
    robot: str
    overrides: tuple[str, ...] = ()
    mission: str = ""
    x_m: float = 0.0
    y_m: float = 0.0
    theta_rad: float = 0.0
    record: str = ""
    flights: str = ""
    state: str = ""
    run: str = ""
    epoch_ns: int = msgspec.field(default_factory=wall_offset_ns)
    clock: str = ""
    config: str = ""
    changes: dict[str, bool | int | float] = {}

    def validated(self) -> StackOptions:
        """Return the same with the robot's file read and validated.

        All processes started with it have this one configuration, restarted ones too, even if the
        file changes.

        Raises
        ------
        ConfigError
            With one line for each error of the file.
        """
        return msgspec.structs.replace(self, config=robot_to_json(self.load_file()))

    def load(self) -> RobotConfig:
        """Return the configuration: the validated one, else that of file and overrides now."""
        return with_values(self.load_file(), self.changes, contradictions)[0]

    def load_file(self) -> RobotConfig:
        """Return the configuration without changed parameters."""
        if self.config:
            return robot_of_json(self.config)
        return load_robot(Path(self.robot), self.overrides)

    def open_clock(self, pacer: Pacer | None = None, slack_ns: int = 0) -> Clock:
        """Return the clock of this robot.

        Parameters
        ----------
        pacer, slack_ns
            This process, if a simulator's clock waits for it, and its allowed lateness [ns].

        Raises
        ------
        LinkError
            If there is no such clock.
        """
        return SimulatedClock(Path(self.clock), pacer, slack_ns) if self.clock else RealClock()

    def command(self, module: str) -> list[str]:
        """Return the command line of the process that `module` implements.

        Raises
        ------
        ConfigError
            If the name of a file is not UTF-8, which logs and messages could not contain; if the
            configuration exceeds the kernel's limit for an argument.
        """
        for name, value in msgspec.structs.asdict(self).items():
            if isinstance(value, str) and not is_utf_8(value):
                raise ConfigError(f"{name}: {value}: not UTF-8")
        argument = msgspec.json.encode(self)
        if len(argument) > _MOST_BYTES:
            raise ConfigError(
                f"{self.robot}: the configuration has {len(argument)} bytes as JSON; processes "
                f"are handed {_MOST_BYTES} at most"
            )
        return [sys.executable, "-m", module, argument.decode()]


def options_of_command_line(arguments: list[str]) -> StackOptions:
    """Read the options that `StackOptions.command` wrote."""
    return msgspec.json.decode(arguments[1], type=StackOptions)
