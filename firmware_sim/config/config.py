"""Reads what the simulator needs from a robot's TOML.

The file is shared with robotctl, which owns the sections on control, limits, run time, safety,
MAVLink and navigation; only the safety monitor's limits are read from them here. In the sections
read here an unknown key is an error; all errors of a file are reported at once.
"""

from __future__ import annotations

import dataclasses
import json
import re
import reprlib
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import Discriminator, Field, Tag, TypeAdapter, ValidationError

from firmware_sim.config.camera_parameters import CameraSection
from firmware_sim.config.drives.kinds import KIND_NAMES, Drive
from firmware_sim.config.motors import CHANNELS, OWN_KIND, MotorTable, motor_table
from firmware_sim.config.outline import BodySection, pieces_of
from firmware_sim.config.parameters import ImuMount, SimulationParameters, SonarMount
from firmware_sim.config.quantities import Point, Positive
from firmware_sim.config.toml_lines import Key, key_lines
from firmware_sim.errors import SimulationError, nearest

T = TypeVar("T")

_KEY_FIRST = re.compile(r"([a-z]\w*(?:\.\w+)*): ")
_QUOTED = re.compile(r"'([^']*)'")


@dataclass(frozen=True, slots=True)
class TomlFile:
    """The tables of a file, and where each key was set.

    Attributes
    ----------
    path
        The file.
    data
        Its tables.
    lines
        Line of each key, counted from 1.
    settings
        `--set KEY=VALUE` of each key that does not come from the file.
    """

    path: Path
    data: dict[str, Any]
    lines: Mapping[Key, int]
    settings: dict[Key, str] = field(default_factory=dict)

    def put(self, dotted: str, value: Any) -> None:
        """Set a dotted key in nested tables; raises SimulationError if one is no table."""
        setting = f"--set {dotted}={_toml(value)}"
        key = tuple(dotted.split("."))
        *tables, last = key
        data = self.data
        for table in tables:
            data = data.setdefault(table, {})
            if not isinstance(data, dict):
                raise SimulationError(f"{setting}: {dotted}: {table} is not a table")
        data[last] = value
        self.settings[key] = setting

    def place(self, key: Key) -> str:
        """Return where a key was set: the setting, or file and line of it or of its table."""
        for length in range(len(key), 0, -1):
            if setting := self.settings.get(key[:length]):
                return setting
            if length == len(key) and (within := self._set_within(key)):
                return within
            if line := self.lines.get(key[:length]):
                return f"{self.path}:{line}"
        return str(self.path)

    def _set_within(self, table: Key) -> str:
        """Return the settings of a table's keys."""
        within = (text for key, text in self.settings.items() if key[: len(table)] == table)
        return " ".join(within)

    def value(self, key: Key) -> Any:
        """Return what the file has at a key; raises LookupError or TypeError without."""
        value: Any = self.data
        for part in key:
            value = value[part]
        return value


@dataclass(frozen=True, slots=True)
class RobotSection:
    """The table `[robot]`, as far as the simulator is concerned."""

    name: str


@dataclass(frozen=True, slots=True)
class CanSection:
    """The table `[can]`, as far as the simulator is concerned."""

    name: str = "main"
    interface: str = "socketcan"
    channel: str = "can0"
    bitrate: Annotated[int, Field(strict=True, ge=10_000, le=1_000_000)] = 1_000_000
    data_bitrate: Annotated[int, Field(strict=True, ge=0, le=8_000_000)] = 0

    def __post_init__(self) -> None:
        for key in ("bitrate", "data_bitrate"):
            rate = getattr(self, key)
            if rate and 1_000_000_000 % rate:
                raise ValueError(f"{key}: {rate}: a bit must last whole nanoseconds")
        if 0 < self.data_bitrate < self.bitrate:
            raise ValueError(
                f"data_bitrate: {self.data_bitrate}: must be 0 or at least bitrate, {self.bitrate}"
            )


def _table_or_tables(value: object) -> str:
    return "tables" if isinstance(value, list | tuple) else "table"


Buses = Annotated[
    Annotated[CanSection, Tag("table")] | Annotated[tuple[CanSection, ...], Tag("tables")],
    Discriminator(_table_or_tables),
]
"""One bus, `[can]`, or several, `[[can]]` each."""


@dataclass(frozen=True, slots=True)
class LimitsSection:
    """The table `[limits]`, as far as the simulator's safety monitor is concerned."""

    v_max_m_s: Positive = 1.0
    omega_max_rad_s: Positive = 2.0


@dataclass(frozen=True, slots=True)
class SafetySection:
    """The table `[safety]`, as far as the simulator's safety monitor is concerned."""

    command_timeout_ms: Annotated[int, Field(strict=True, ge=10, le=1000)] = 90


@dataclass(frozen=True, slots=True)
class PowerSection:
    """The table `[power]`, as far as the simulator is concerned: source of the supply voltage."""

    source: Literal["node", "drives"] = "node"


@dataclass(frozen=True, slots=True)
class RobotConfig:
    """One robot: geometry, sonars, camera, buses and physics."""

    robot: RobotSection
    drive: Drive
    simulation: SimulationParameters
    body: BodySection = field(default_factory=BodySection)
    sonar: Annotated[tuple[SonarMount, ...], Field(max_length=16)] = ()
    can: Buses = CanSection()
    nodes: Mapping[str, str] = field(default_factory=dict)
    limits: LimitsSection = LimitsSection()
    safety: SafetySection = SafetySection()
    camera: CameraSection | None = None
    imu: ImuMount = field(default_factory=ImuMount)
    motor: tuple[dict[str, Any], ...] = ()
    power: PowerSection = PowerSection()

    def __post_init__(self) -> None:
        if not self.outline:
            raise ValueError("simulation.body: missing, and so is body.outline, which would do")
        self.drive.chassis(self.simulation)
        drives = [motor.name for motor in self.motors]
        for name in self.simulation.twin:
            if name not in drives:
                raise ValueError(f"simulation.twin.{name}: no such drive{nearest(name, drives)}")
        if self.camera is not None:
            self.simulation.camera.true_mount(self.camera.mount)
        names = [bus.name for bus in self.buses]
        if len(set(names)) < len(names) or not names:
            raise ValueError(f"can: each bus must have a name of its own, found {', '.join(names)}")
        for node, name in self.nodes.items():
            if name not in names:
                raise ValueError(f"nodes.{node}: no bus {name!r}{nearest(name, names)}")

    @property
    def outline(self) -> tuple[Point, ...]:
        """Corners of the true outline without the parts beside it, in base [m]."""
        return self.simulation.body or self.body.outline

    @property
    def outlines(self) -> tuple[tuple[tuple[Point, ...], ...], ...]:
        """Corners of the true outline and of each part beside it, for each state of the body."""
        return tuple(
            (
                self.outline,
                *(
                    part.outline
                    for part in self.body.part
                    if not part.states or state in part.states
                ),
            )
            for state in self.body.states or ("",)
        )

    @property
    def bodies(self) -> tuple[list[tuple[Point, ...]], ...]:
        """Corners of convex pieces that make up the body, counter-clockwise, for each state."""
        return tuple(
            [piece for outline in outlines for piece in pieces_of(outline)]
            for outlines in self.outlines
        )

    @property
    def motors(self) -> tuple[MotorTable, ...]:
        """The motor drives of the file; without one, our own controller, if it has the channels."""
        if self.motor:
            return tuple(motor_table(keys) for keys in self.motor)
        wheels = self.drive.wheel_names
        if len(wheels) > CHANNELS:
            return ()
        axes = [{"actuator": name, "axis": number} for number, name in enumerate(wheels, 1)]
        bus = self.nodes.get("drive", "")
        return (motor_table({"kind": OWN_KIND, "name": "drive", "bus": bus, "axes": axes}),)

    @property
    def buses(self) -> tuple[CanSection, ...]:
        """All buses, in the order of the file."""
        return self.can if isinstance(self.can, tuple) else (self.can,)


_ROBOT: TypeAdapter[RobotConfig] = TypeAdapter(RobotConfig)


def load_robot(path: Path, overrides: Mapping[str, Any] | None = None) -> RobotConfig:
    """Read and validate a robot's file.

    Parameters
    ----------
    path
        TOML file like those in `configs/`.
    overrides
        Values that replace those of the file, by dotted key: `{"simulation.battery.charge": 0.7}`.

    Raises
    ------
    SimulationError
        The file cannot be read or is wrong; one line for each error.
    """
    file = read_toml(path)
    for key, value in (overrides or {}).items():
        file.put(key, value)
    return validate(_ROBOT, file)


def parse_override(text: str) -> tuple[str, Any]:
    """Return key and value of `key=value`, the value in TOML.

    Raises
    ------
    SimulationError
        If the text has another form, or the simulator reads no such table: the setting would have
        no effect.
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
        hint = f'; did you mean "simulation.{key}"?' if table in own else nearest(table, tables)
        raise SimulationError(
            f"--set {text}: the simulator reads no table {table}, allowed: "
            f"{', '.join(tables)}{hint}"
        )
    return key, parsed


def read_toml(path: Path) -> TomlFile:
    """Parse a TOML file; raises SimulationError naming the file."""
    try:
        text = path.read_text(encoding="utf-8-sig")
        return TomlFile(path, tomllib.loads(text), key_lines(text))
    except (OSError, UnicodeDecodeError) as error:
        raise SimulationError(f"{path}: cannot be read: {error}") from error
    except (ValueError, RecursionError) as error:  # ValueError: also for absurdly long numbers
        raise SimulationError(f"{path}: {error}") from error


def validate(adapter: TypeAdapter[T], file: TomlFile) -> T:
    """Turn the tables of a file into values; raises SimulationError with all of its errors."""
    try:
        return adapter.validate_python(file.data)
    except ValidationError as error:
        known = _known_keys(adapter)
        items = error.errors()
        # An error in a list makes the list wrong; report it once.
        within = {item["loc"][:n] for item in items for n in range(len(item["loc"]))}
        lines = [_line(file, item, known) for item in items if item["loc"] not in within]
        raise SimulationError("\n".join(lines)) from error


def _line(file: TomlFile, item: Any, known: list[str]) -> str:
    """One error of pydantic as `file:line: key: rule, found value`."""
    # The tag of a union appears in the location, but is not part of the key.
    tags = {*KIND_NAMES, "box", "pillar", "table", "tables"}
    head, *rest = item["loc"] or ("",)
    key: Key = (head, *(part for part in rest if part not in tags)) if item["loc"] else ()
    key, problem = _problem(file, key, item, known)
    dotted = ".".join(map(str, key))
    return ": ".join(part for part in (file.place(key), dotted, problem) if part)


def _problem(file: TomlFile, key: Key, item: Any, known: list[str]) -> tuple[Key, str]:
    """Return the key to blame and what is wrong with it."""
    kind, found, context = item["type"], item["input"], item.get("ctx", {})
    if kind in {"extra_forbidden", "unexpected_keyword_argument"}:
        return key, f"unknown key{nearest(str(item['loc'][-1]), known)}"
    if kind == "missing":
        return key, "missing"
    if kind == "union_tag_not_found":
        return (*key, "kind"), "missing"
    if kind == "value_error":
        return _named_key(file, key, str(context["error"]))
    hint = ""
    if kind == "union_tag_invalid":
        key, found = (*key, "kind"), context["tag"]
        allowed = context["expected_tags"].replace("'", "")
        rule, hint = f"must be one of {allowed}", nearest(found, allowed.split(", "))
    elif kind in {"dataclass_type", "model_attributes_type"}:
        rule = "must be a table"
    elif kind == "tuple_type":
        is_table, dotted = isinstance(found, dict), ".".join(map(str, key))
        rule = f"each must be a table of its own, [[{dotted}]]" if is_table else "must be a list"
    elif kind in {"too_long", "too_short"}:
        end, words = ("max", "at most") if kind == "too_long" else ("min", "at least")
        rule, found = f"must have {words} {context[f'{end}_length']} entries", len(found)
    else:
        rule = item["msg"].replace("Input should be", "must be")
        rule = rule.replace("String should match pattern", "must match")
        if kind in {"enum", "literal_error"}:
            hint = nearest(str(found), _QUOTED.findall(context["expected"]))
    return key, f"{rule}, found {reprlib.repr(found)}{hint}"


def _named_key(file: TomlFile, table: Key, message: str) -> tuple[Key, str]:
    """Return the key that a constructor's message begins with, and the rest of it.

    Without one, its table and the whole message.
    """
    named = _KEY_FIRST.match(message)
    if named is None:
        return table, message
    key, rule = (*table, *named[1].split(".")), message[named.end() :]
    try:
        found = file.value(key)
    except (LookupError, TypeError):  # a default, which the message names where it matters
        return key, rule
    is_told = isinstance(found, dict | list) or reprlib.repr(found) in rule
    return key, rule if is_told else f"{rule}, found {found!r}"


def _toml(value: Any) -> str:
    """Return a value about as the user wrote it."""
    if isinstance(value, bool):
        return str(value).lower()
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else str(value)


def _known_keys(adapter: TypeAdapter[T]) -> list[str]:
    """Names of all keys that a file may have."""
    schema = adapter.json_schema()
    tables = [schema, *schema.get("$defs", {}).values()]
    return sorted({key for table in tables for key in table.get("properties", {})})
