"""The progress record beside the robot's file: completed steps, and how to undo each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec

from robotctl.config.file_edit import Change
from robotctl.errors import ConfigError


class Progress(msgspec.Struct):
    """Steps that are done, and the changes that undo them.

    Attributes
    ----------
    done
        Names of the steps that are done.
    undo
        Changes that undo those of each step, by its name: key, value.
    """

    done: list[str] = msgspec.field(default_factory=list)
    undo: dict[str, list[tuple[list[str | int], Any]]] = msgspec.field(default_factory=dict)

    def note(self, step: str, undo: tuple[Change, ...]) -> None:
        """Note the changes that undo those of a step."""
        earlier = self.undo.get(step, [])
        self.undo[step] = [*((list(key), value) for key, value, _ in undo), *earlier]

    def finish(self, step: str) -> None:
        """Note that a step is done."""
        if step not in self.done:
            self.done.append(step)

    def forget(self, step: str) -> None:
        """Note that a step is undone."""
        self.undo.pop(step, None)
        self.done = [each for each in self.done if each != step]

    def changes(self, step: str) -> tuple[Change, ...]:
        """Return the changes that undo a step."""
        return tuple(Change(tuple(key), value) for key, value in self.undo.get(step, []))


def progress_file(robot: Path) -> Path:
    """Return the path of the progress record of a robot's file."""
    return robot.with_suffix(".setup.json")


def load_progress(robot: Path) -> Progress:
    """Return the progress of a robot's file; empty without a record.

    Raises
    ------
    ConfigError
        If the record is unreadable.
    """
    file = progress_file(robot)
    try:
        return msgspec.json.decode(file.read_bytes(), type=Progress)
    except FileNotFoundError:
        return Progress()
    except (OSError, msgspec.MsgspecError) as error:
        raise ConfigError(f"{file}: cannot be read: {error}; remove it to begin anew") from error
