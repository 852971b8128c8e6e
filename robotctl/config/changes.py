"""Changes of parameters in a robot's configuration, stored over restarts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import msgspec

from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig, contradictions
from robotctl.config_values import Value, value_at, with_values
from robotctl.runtime.storage.state_file import StateError, StateFile

NAME: Final = "parameters.json"


class Changes(msgspec.Struct, frozen=True):
    """Values that differ from those of the robot's file, by their dotted keys."""

    values: dict[str, bool | int | float]


class ParameterFile:
    """The file of stored parameters in the robot's state folder; "": there is none."""

    def __init__(self, directory: str) -> None:
        self._file = StateFile(Path(directory) / NAME, Changes) if directory else None

    def load(self) -> tuple[dict[str, Value], tuple[str, ...]]:
        """Return the stored values, and a sentence for each file that is damaged or unreadable."""
        if self._file is None:
            return {}, ()
        try:
            found, notes = self._file.load()
        except StateError as error:
            return {}, (str(error),)
        return ({} if found is None else dict(found.values)), notes

    def save(self, values: Mapping[str, Value]) -> bool:
        """Store exactly these values; return whether they would survive a power cut."""
        if self._file is None:
            return False
        try:
            self._file.save(Changes(dict(values)))
        except StateError:
            return False
        return True

    def drop_those_of(self, file: RobotConfig) -> None:
        """Forget values equal to the robot's file's, as after they were written into it.

        Otherwise they would override later changes there.
        """
        values, _ = self.load()
        others = {key: value for key, value in values.items() if value_at(file, key) != value}
        if others != values:
            self.save(others)


def kept_values(options: StackOptions) -> tuple[dict[str, Value], tuple[str, ...]]:
    """Return the stored parameters that are valid, and the problems of others.

    Raises
    ------
    ConfigError
        With one line for each error of the robot's file.
    """
    values, notes = ParameterFile(options.state).load()
    _, refused = with_values(options.load_file(), values, contradictions)
    notes += tuple(
        f"parameter {key} = {values[key]} is left out: {why}" for key, why in refused.items()
    )
    return {key: value for key, value in values.items() if key not in refused}, notes


def with_changes(options: StackOptions) -> tuple[StackOptions, tuple[str, ...]]:
    """Return the options with the stored parameters, and notes on them for people.

    Raises
    ------
    ConfigError
        With one line for each error of the robot's file.
    """
    kept, notes = kept_values(options)
    if kept:
        words = ", ".join(f"{key} = {value}" for key, value in kept.items())
        notes += (f"parameters that replace those of the robot's file: {words}",)
    return msgspec.structs.replace(options, changes=kept), notes
