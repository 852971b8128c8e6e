"""The progress record: which steps are done, and what undoes each; beside the robot's file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec

from robotctl.config.file_edit import Change
from robotctl.errors import ConfigError


class Progress(msgspec.Struct):
    """What was done.

    Attributes
    ----------
    undo
        Changes that undo each step that is done, by its name: key, value.
    """

    undo: dict[str, list[tuple[list[str | int], Any]]] = msgspec.field(default_factory=dict)

    def finish(self, step: str, undo: tuple[Change, ...]) -> None:
        """Note that a step is done, and what undoes it."""
        earlier = self.undo.get(step, [])
        self.undo[step] = [*((list(key), value) for key, value, _ in undo), *earlier]

    def changes(self, step: str) -> tuple[Change, ...]:
        """Return the changes that undo a step."""
        return tuple(Change(tuple(key), value) for key, value in self.undo.get(step, []))


def progress_file(robot: Path) -> Path:
    """Return where the progress of a robot's file is kept."""
    return robot.with_suffix(".setup.json")


def load_progress(robot: Path) -> Progress:
    """Return the progress with a robot's file; an empty one where there is none.

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
