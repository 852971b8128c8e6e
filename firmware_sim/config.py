"""Reads what the simulator needs from a robot's TOML.

The file is shared with robotctl, which owns the sections on control, limits, run time, safety,
MAVLink and navigation: they are not looked at here. In the sections read here an unknown key is an
error; all errors of a file are reported at once.
"""

from __future__ import annotations

import dataclasses
import difflib
import reprlib
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import Field, TypeAdapter, ValidationError

from firmware_sim.camera_parameters import CameraSection
from firmware_sim.errors import SimulationError
from firmware_sim.parameters import Drive, SimulationParameters, SonarMount
from firmware_sim.quantities import Positive

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
    bitrate: Annotated[int, Field(strict=True, ge=10_000, le=1_000_000)] = 1_000_000

    def __post_init__(self) -> None:
        if 1_000_000_000 % self.bitrate:
            raise ValueError(f"bitrate: {self.bitrate}: a bit must last whole nanoseconds")


@dataclass(frozen=True, slots=True)
class LimitsSection:
    """The table `[limits]`, as far as the simulator's safety monitor is concerned."""

    v_max_m_s: Positive = 1.0
    omega_max_rad_s: Positive = 2.0


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

    def __post_init__(self) -> None:
        if self.camera is not None:
            self.simulation.camera.true_mount(self.camera.mount)


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
    """Return key and value of `key=value`, the value in TOML.

    Raises
    ------
    SimulationError
        If the text is not of that form, or the simulator reads no such table: the setting would
        do nothing.
    """
    key, _, value = text.partition("=")
    key = key.strip()
    table, *rest = key.split(".")
    try:
        parsed = tomllib.loads(f"value = {value}")["value"]
    except (ValueError, RecursionError):
        parsed = None
    if parsed is None or not all((table, *rest)):
        raise SimulationError(
            f"--set {text}: not of the form key.subkey=value, the value in TOML: text in quotes"
        )
    tables = [field.name for field in dataclasses.fields(RobotConfig)]
    if table not in tables:
        own = [field.name for field in dataclasses.fields(SimulationParameters)]
        hint = f'; did you mean "simulation.{key}"?' if table in own else _hint(table, tables)
        raise SimulationError(
            f"--set {text}: the simulator reads no table {table}, allowed: "
            f"{', '.join(tables)}{hint}"
        )
    return key, parsed


def read_toml(path: Path) -> dict[str, Any]:
    """Parse a TOML file; raises SimulationError naming the file."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError) as error:
        raise SimulationError(f"{path}: cannot be read: {error}") from error
    except (ValueError, RecursionError) as error:  # ValueError: numbers beyond all sense too
        raise SimulationError(f"{path}: {error}") from error


def validate(adapter: TypeAdapter[T], data: Mapping[str, Any], path: Path) -> T:
    """Turn the tables of a file into values; raises SimulationError with all of its errors."""
    try:
        return adapter.validate_python(data)
    except ValidationError as error:
        known = _known_keys(adapter)
        items = error.errors()
        # What is wrong in a list makes the list wrong: that is said once.
        within = {item["loc"][:n] for item in items for n in range(len(item["loc"]))}
        lines = [_line(path, item, known) for item in items if item["loc"] not in within]
        raise SimulationError("\n".join(lines)) from error


def _line(path: Path, item: Any, known: list[str]) -> str:
    """One error of pydantic as `file: key: rule`."""
    # The tag of a union appears in the location, but is not part of the key.
    tags = {"differential", "tricycle", "ackermann", "box", "pillar"}
    head, *rest = item["loc"] or ("",)
    key = ".".join([str(head), *(str(part) for part in rest if part not in tags)])
    kind, found, context = item["type"], item["input"], item.get("ctx", {})
    hint = ""
    if kind in {"extra_forbidden", "unexpected_keyword_argument"}:
        return f"{path}: {key}: unknown key{_hint(str(item['loc'][-1]), known)}"
    if kind == "missing":
        return f"{path}: {key}: missing"
    if kind == "union_tag_not_found":
        return f"{path}: {key}.kind: missing"
    if kind == "value_error":
        return ": ".join(part for part in (str(path), key, str(context["error"])) if part)
    if kind == "union_tag_invalid":
        key, found = f"{key}.kind", context["tag"]
        allowed = context["expected_tags"].replace("'", "")
        rule, hint = f"must be one of {allowed}", _hint(found, allowed.split(", "))
    elif kind in {"dataclass_type", "model_attributes_type"}:
        rule = "must be a table"
    elif kind == "tuple_type":
        is_table = isinstance(found, dict)
        rule = f"each must be a table of its own, [[{key}]]" if is_table else "must be a list"
    elif kind in {"too_long", "too_short"}:
        end, words = ("max", "at most") if kind == "too_long" else ("min", "at least")
        rule, found = f"must have {words} {context[f'{end}_length']} entries", len(found)
    else:
        rule = item["msg"].replace("Input should be", "must be")
        rule = rule.replace("String should match pattern", "must match")
    return f"{path}: {key}: {rule}, found {reprlib.repr(found)}{hint}"


def _hint(word: str, allowed: list[str]) -> str:
    near = difflib.get_close_matches(word, allowed, n=1)
    return f'; did you mean "{near[0]}"?' if near else ""


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
