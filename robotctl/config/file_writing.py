"""Writing of values into a robot's file, which stays valid and keeps its comments."""

from __future__ import annotations

import itertools
import os
import threading
from collections.abc import Iterable, Mapping
from pathlib import Path

from robotctl import toml_source
from robotctl.config.file_edit import Change, edit
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig, contradictions, load_robot, robot_to_json
from robotctl.config_values import Value, value_at
from robotctl.errors import ConfigError
from robotctl.runtime.storage.atomic_file import write_whole


def changed_file(file: Path, changes: Iterable[Change]) -> tuple[str, tuple[Change, ...]]:
    """Return the text of a robot's file with changes, and the changes that undo them.

    Raises
    ------
    ConfigError
        If the file would be invalid with them.
    """
    after, undo = edit(file.read_text(encoding="utf-8-sig"), changes)
    toml_source.parse(after, RobotConfig, str(file), rules=contradictions)
    return after, undo


class ParameterWriter:
    """Writes the parameters of a running robot into its file.

    Parameters
    ----------
    options
        Options of the robot, with its configuration at the start.
    """

    def __init__(self, options: StackOptions) -> None:
        self._file = Path(options.robot).resolve()
        self._overrides = options.overrides
        self._began = options.config or robot_to_json(options.load_file())
        self._written: str | None = None
        self._lock = threading.Lock()

    @property
    def writable(self) -> str:
        """Path of the file; empty if this process may not write it."""
        may = os.access(self._file, os.W_OK) and os.access(self._file.parent, os.W_OK)
        return str(self._file) if may else ""

    def save(self, values: Mapping[str, Value]) -> tuple[str, str, tuple[str, ...]]:
        """Write changed values, by dotted keys; return file, copy of the old one, and keys.

        The names of file and copy are without their folder; that of the copy is empty if nothing
        has changed.

        Raises
        ------
        ConfigError
            If the file was edited since the robot's start, or would be invalid; it stays unchanged.
        OSError
            If it cannot be written.
        """
        with self._lock:
            found = self._unchanged()
            new = {key: each for key, each in values.items() if value_at(found, key) != each}
            if not new:
                return self._file.name, "", ()
            changes = [Change((*key.split("."),), value) for key, value in new.items()]
            after, _ = changed_file(self._file, changes)
            copy = self._copy()
            write_whole(self._file, after)
            self._written = after
            return self._file.name, copy, tuple(new)

    def _unchanged(self) -> RobotConfig:
        """Return the present configuration; raise `ConfigError` if the file was edited."""
        found = load_robot(self._file, self._overrides)
        is_own = self._file.read_text(encoding="utf-8-sig") == self._written
        if not is_own and robot_to_json(found) != self._began:
            raise ConfigError(
                f"{self._file}: has changed since the robot started; look at the patch and enter "
                "it by hand, or restart robotctl"
            )
        return found

    def _copy(self) -> str:
        """Copy the present file to the next free name; return that."""
        content = self._file.read_bytes()
        for number in itertools.count(1):
            copy = self._file.with_name(f"{self._file.name}.~{number}~")
            if not copy.exists():
                break
        write_whole(copy, content)
        return copy.name
