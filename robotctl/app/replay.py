"""Replay of a recorded run: the same inputs through the same core."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pydantic

from robotctl.app.config import RobotConfig
from robotctl.app.options import StackOptions
from robotctl.app.robot import make_core
from robotctl.runtime.messages import WheelCommand
from robotctl.runtime.recorder import RecordError, Tick, read_record, replay


@dataclass(frozen=True, slots=True)
class Replay:
    """What a replay showed.

    Parameters
    ----------
    version
        robotctl that made the record.
    agreed
        Ticks whose command came out the same, bit for bit, before the first that did not.
    different
        The first tick that differs; None where all agree.
    command
        The command computed for it.
    """

    version: str
    agreed: int
    different: Tick | None
    command: WheelCommand


def replay_file(path: Path) -> Replay:
    """Replay a record with the configuration that it carries.

    Raises
    ------
    RecordError
        If the file cannot be read, is no record, or is of an incompatible robotctl.
    """
    try:
        with path.open("rb") as file:
            header, ticks = read_record(file, str(path))
            config = pydantic.TypeAdapter(RobotConfig).validate_json(header.robot_json)
            start = StackOptions(
                "replay", "", x_m=header.x_m, y_m=header.y_m, theta_rad=header.theta_rad
            )
            agreed, different, command = replay(make_core(config, start), ticks)
    except OSError as error:
        raise RecordError(f"{path}: cannot be read: {error.strerror}") from error
    except pydantic.ValidationError as error:
        raise RecordError(
            f"{path}: made by robotctl {header.version}, whose configuration this one does not "
            f"read: {error}"
        ) from error
    return Replay(header.version, agreed, different, command)
