"""Conditions on a run's report: `localisation.error.rmse_m <= 0.1`."""

from __future__ import annotations

import functools
import operator
import re
import tomllib
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import msgspec

from robotctl.app.scoring.score import Report, bus_report, loop_report
from robotctl.messages.control import BusStatus, LoopStatistics
from robotctl.toml_source import nearest

ReportValues: TypeAlias = Mapping[str, Any]
"""A report as `read_report` returns it."""

_COMPUTING_TIMES: Final = (
    "real_time_factor",
    "held_up_ms",
    "loop.step_us",
    "loop.stage_us",
    "localisation.step_ms",
    "camera.step_ms",
)
"""Fields that measure this computer: they differ between two runs of one seed."""

_OPERATORS: Final[Mapping[str, Callable[[Any, Any], bool]]] = {
    "<=": operator.le,
    ">=": operator.ge,
    "!=": operator.ne,
    "<": operator.lt,
    ">": operator.gt,
    "=": operator.eq,
}
_CONDITION: Final = re.compile(r"\s*([\w.]+)\s*(<=|>=|!=|<|>|=)\s*(\S.*?)\s*")


@dataclass(frozen=True, slots=True)
class Condition:
    """A condition on one field of a report."""

    field: str
    comparison: str
    bound: bool | float | str

    def __str__(self) -> str:
        """Return the condition as it is written in a file."""
        bound = str(self.bound).lower() if isinstance(self.bound, bool) else self.bound
        return f"{self.field} {self.comparison} {bound}"

    def violation(self, report: ReportValues) -> str:
        """Return what was found instead; empty if the report fulfils the condition."""
        found = value_of(report, self.field)
        if found is None:
            return f"{self.field}: the report has none"
        if _OPERATORS[self.comparison](found, self.bound):
            return ""
        return f"{self.field} = {shown(found)}, not {self.comparison} {shown(self.bound)}"


def shown(value: Any) -> str:
    """Return a value of a report for people."""
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.4g}" if isinstance(value, float) else str(value)


@functools.cache
def parse_condition(text: str) -> Condition:
    """Return the condition of a text.

    Raises
    ------
    ValueError
        If it is none, names no field of the report, or compares it with what it never is.
    """
    match = _CONDITION.fullmatch(text)
    if match is None:
        raise ValueError(f'must be like "collisions = 0", with {", ".join(_OPERATORS)}')
    name, comparison, bound_text = match.groups()
    if name.startswith(_COMPUTING_TIMES):
        raise ValueError(f"{name} measures this computer, and differs between equal runs")
    kinds = report_fields()
    if name not in kinds:
        raise ValueError(f"unknown field {name}{nearest(name, [*kinds])}")
    kind = kinds[name]
    bound: Any
    try:
        bound = tomllib.loads(f"value = {bound_text}")["value"]
    except ValueError:
        bound = bound_text
    allowed: tuple[type, ...] = {bool: (bool,), str: (str,)}.get(kind, (int, float))
    if type(bound) not in allowed:
        words = {bool: "true or false", str: "a text"}.get(kind, "a number")
        raise ValueError(f"{name} is compared with {words}, found {bound_text}")
    if kind is not float and kind is not int and comparison not in {"=", "!="}:
        raise ValueError(f"{name} has no order: = and != are allowed, found {comparison}")
    return Condition(name, comparison, bound)


def read_report(content: bytes) -> dict[str, Any]:
    """Return the report of `sim --report` without what differs between two runs of one seed."""
    report: dict[str, Any] = msgspec.json.decode(content)
    for name in _COMPUTING_TIMES:
        *above, last = name.split(".")
        table: Any = report
        for part in above:
            table = (table or {}).get(part)
        if isinstance(table, dict):
            table.pop(last, None)
    return report


def value_of(report: ReportValues, field: str) -> Any:
    """Return a field of a report by its dotted name; None if the report has none."""
    found: Any = report
    for part in field.split("."):
        found = found.get(part) if isinstance(found, Mapping) else None
    return found


def violations(conditions: Iterable[Condition], report: ReportValues) -> tuple[str, ...]:
    """Return what of a report fulfils not all of some conditions, in words."""
    found = (condition.violation(report) for condition in conditions)
    return tuple(each for each in found if each)


def report_fields() -> dict[str, type]:
    """Return the fields of a report that can be compared, by dotted name, with their types."""
    examples = {"loop": loop_report(LoopStatistics()), "bus": bus_report(BusStatus())}
    fields = dict(_struct_fields(Report, ""))
    for name, example in examples.items():
        fields |= dict(_example_fields(example, name))
    return {name: kind for name, kind in fields.items() if not name.startswith(_COMPUTING_TIMES)}


def _struct_fields(struct: type[msgspec.Struct], at: str) -> Iterator[tuple[str, type]]:
    """Yield the fields of a struct and of those inside it."""
    for name, hint in typing.get_type_hints(struct).items():
        union = typing.get_origin(hint) in (typing.Union, types.UnionType)
        kind = next(k for k in typing.get_args(hint) if k is not type(None)) if union else hint
        if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
            yield from _struct_fields(kind, f"{at}{name}.")
        elif kind in (bool, int, float, str):
            yield f"{at}{name}", kind


def _example_fields(example: Mapping[str, Any], at: str) -> Iterator[tuple[str, type]]:
    """Yield the fields of a table that has no class."""
    for name, value in example.items():
        if isinstance(value, Mapping):
            yield from _example_fields(value, f"{at}.{name}")
        elif isinstance(value, bool | int | float | str):
            yield f"{at}.{name}", type(value)
