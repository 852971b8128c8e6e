"""Replay of a recorded run: the same inputs through the same core."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from robotctl.app.processes.robot import make_core
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig, robot_of_json
from robotctl.errors import ConfigError
from robotctl.runtime.flight.recorder import (
    Difference,
    RecordError,
    RecordHeader,
    Replayed,
    is_cut,
    read_record,
    replay,
)


@dataclass(frozen=True, slots=True)
class Replay:
    """Result of a replay.

    Parameters
    ----------
    version
        robotctl that made the record.
    result
        Ticks that agreed, gaps, and the first tick that differs.
    is_cut
        Whether the record ends within a message.
    """

    version: str
    result: Replayed
    is_cut: bool


def replay_file(path: Path) -> Replay:
    """Replay a record, whole or dumped from the flight ring, with the configuration it carries.

    Raises
    ------
    RecordError
        If the file cannot be read, is no record, or is of an incompatible robotctl.
    """
    try:
        with path.open("rb") as file:
            header, entries = read_record(file, str(path))
            config, options = robot_of(header, path)
            result = replay(lambda: make_core(config, options), entries, str(path), header.fields)
            cut = is_cut(file)
    except OSError as error:
        raise RecordError(f"{path}: cannot be read: {error.strerror}") from error
    return Replay(header.version, result, cut)


def differences(difference: Difference) -> list[tuple[str, str, str]]:
    """Return name, recorded value and computed value of each output that differs."""
    recorded: Any = msgspec.structs.asdict(difference.tick.outputs)
    computed: Any = msgspec.structs.asdict(difference.outputs)
    for values in (recorded, computed):
        command = msgspec.structs.asdict(values.pop("command"))
        values.update({f"command.{name}": value for name, value in command.items()})
    return [
        (name, repr(recorded[name]), repr(computed[name]))
        for name in sorted(recorded)
        if repr(recorded[name]) != repr(computed[name])
    ]


def robot_of(header: RecordHeader, path: Path) -> tuple[RobotConfig, StackOptions]:
    """Return the robot of a record and its start.

    Raises
    ------
    RecordError
        If its configuration cannot be read here.
    """
    try:
        config = robot_of_json(header.robot_json)
    except ConfigError as error:
        raise RecordError(
            f"{path}: made by robotctl {header.version}, whose configuration this one does not "
            f"read: {error}"
        ) from error
    options = StackOptions(
        "replay", "", x_m=header.x_m, y_m=header.y_m, theta_rad=header.theta_rad
    )  # fmt: skip
    try:
        make_core(config, options)
    except ValueError as error:
        raise RecordError(f"{path}: the configuration in it is damaged: {error}") from error
    return config, options
