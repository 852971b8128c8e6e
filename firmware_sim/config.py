"""Reads what the simulator needs from a robot's TOML.

The file is shared with robotctl, which owns the sections on control, limits, run time, safety,
MAVLink and navigation: they are not looked at here. In the sections read here an unknown key is an
error; all errors of a file are reported at once.
"""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import Field, TypeAdapter, ValidationError

from firmware_sim.camera_parameters import CameraSection
from firmware_sim.errors import SimulationError
from firmware_sim.parameters import Drive, SimulationParameters, SonarMount

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class RobotSection:
    """The table `[robot]`, as far as the simulator is concerned."""

    name: str


@dataclass(frozen=True, slots=True)
class CanSection:
    """The table `[can]`, as far as the simulator is concerned."""

    interface: str = "socketcan"
    channel: str = "can0"
    bitrate: Annotated[int, Field(strict=True, gt=0)] = 1_000_000


@dataclass(frozen=True, slots=True)
class LimitsSection:
    """The table `[limits]`, as far as the simulator's safety monitor is concerned."""

    v_max_m_s: Annotated[float, Field(gt=0)] = 1.0
    omega_max_rad_s: Annotated[float, Field(gt=0)] = 2.0


@dataclass(frozen=True, slots=True)
class RobotConfig:
    """One robot: geometry, sonars, camera and physics."""

    robot: RobotSection
    drive: Drive
    simulation: SimulationParameters
    sonar: Annotated[tuple[SonarMount, ...], Field(max_length=16)] = ()
    can: CanSection = CanSection()
    limits: LimitsSection = LimitsSection()
    camera: CameraSection | None = None


_ROBOT: TypeAdapter[RobotConfig] = TypeAdapter(RobotConfig)


def load_robot(path: Path, overrides: Mapping[str, Any] | None = None) -> RobotConfig:
    """Read and validate a robot's file.

    Parameters
    ----------
    path
        A TOML as those in `configs/`.
    overrides
        Values that replace those of the file, by dotted key: `{"simulation.battery.charge": 0.7}`.

    Raises
    ------
    SimulationError
        The file cannot be read or is wrong; one line for each error.
    """
    data = read_toml(path)
    for key, value in (overrides or {}).items():
        _put(data, key, value, path)
    return validate(_ROBOT, data, path)


def parse_override(text: str) -> tuple[str, Any]:
    """Return key and value of `key=value`, the value in TOML; else raises SimulationError."""
    key, _, value = text.partition("=")
    try:
        return key.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        raise SimulationError(f"--set {text}: not of the form key.subkey=value in TOML") from None


def read_toml(path: Path) -> dict[str, Any]:
    """Parse a TOML file; raises SimulationError naming the file."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise SimulationError(f"{path}: cannot be read: {error}") from error
    except tomllib.TOMLDecodeError as error:
        raise SimulationError(f"{path}: {error}") from error


def validate(adapter: TypeAdapter[T], data: Mapping[str, Any], path: Path) -> T:
    """Turn the tables of a file into values; raises SimulationError with all of its errors."""
    try:
        return adapter.validate_python(data)
    except ValidationError as error:
        known = _known_keys(adapter)
        lines = [_line(path, item, known) for item in error.errors()]
        raise SimulationError("\n".join(lines)) from error


def _line(path: Path, item: Any, known: list[str]) -> str:
    """One error of pydantic as `file: key: rule`."""
    # The tag of a union appears in the location, but is not part of the key.
    tags = {"differential", "tricycle", "ackermann", "box", "pillar"}
    head, *rest = item["loc"] or ("",)
    key = ".".join([str(head), *(str(part) for part in rest if part not in tags)])
    if item["type"] in {"extra_forbidden", "unexpected_keyword_argument"}:
        near = difflib.get_close_matches(str(item["loc"][-1]), known, n=1)
        hint = f'; did you mean "{near[0]}"?' if near else ""
        return f"{path}: {key}: unknown key{hint}"
    if item["type"] == "missing":
        return f"{path}: {key}: missing"
    rule = item["msg"].removeprefix("Value error, ")
    return f"{path}: {key}: {rule}, found {item['input']!r}"


def _known_keys(adapter: TypeAdapter[T]) -> list[str]:
    """Names of all keys that a file may have."""
    schema = adapter.json_schema()
    tables = [schema, *schema.get("$defs", {}).values()]
    return sorted({key for table in tables for key in table.get("properties", {})})


def _put(data: dict[str, Any], key: str, value: Any, path: Path) -> None:
    """Set a dotted key in nested tables."""
    *tables, last = key.split(".")
    for table in tables:
        data = data.setdefault(table, {})
        if not isinstance(data, dict):
            raise SimulationError(f"{path}: {key}: {table} is not a table")
    data[last] = value
