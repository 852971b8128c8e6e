"""Single values of a configuration, which is a tree of frozen dataclasses, by their dotted keys."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final, TypeAlias, TypeVar

from robotctl.errors import InvalidValue

T = TypeVar("T")

Value: TypeAlias = bool | int | float
_NAMES: Final = re.compile(r"(\w+(?:, \w+)*)(?: : .*)?")
"""Line of a docstring that names keys."""

Rules: TypeAlias = Callable[[Any], Iterable[tuple[tuple[str | int, ...], str]]]
"""Yields what no value alone shows: the key to blame and what is wrong."""


def descriptions(docstring: str) -> dict[str, str]:
    """Return what the section `Parameters` of a table's docstring, unindented, says of each key."""
    found: dict[str, str] = {}
    section = docstring.partition("Parameters\n----------\n")[2].partition("\n\nRaises\n")[0]
    names: tuple[str, ...] = ()
    for line in section.splitlines():
        if line and not line[0].isspace():
            match = _NAMES.fullmatch(line)
            names = tuple(match[1].split(", ")) if match else ()
        for name in names if line[:1].isspace() else ():
            found[name] = f"{found.get(name, '')} {line.strip()}".strip()
    return found


ABOVE_0: Final = math.nextafter(0.0, 1.0)
"""Lower bound of what must be above 0."""


def check_ranges(config: object, **ranges: tuple[float, float]) -> None:
    """Refuse a value of a configuration that is outside its range, ends included, or infinite.

    Raises
    ------
    InvalidValue
        Names the first such key, what was found and what is allowed.
    """
    for key, (least, most) in ranges.items():
        value = getattr(config, key)
        if not (least <= value <= most and math.isfinite(value)):
            raise InvalidValue(key, f"{value} found, {_allowed(least, most)} allowed", value)


def _allowed(least: float, most: float) -> str:
    if math.isfinite(most):
        return f"{least:g} to {most:g}"
    return "a finite number > 0" if least == ABOVE_0 else f"{least:g} or more"


def value_at(config: object, key: str) -> Value | None:
    """Return the number at a dotted key; None if the configuration has none there."""
    for part in key.split("."):
        config = getattr(config, part, None)
    return config if isinstance(config, bool | int | float) else None


def replaced(config: T, key: str, value: Value) -> T:
    """Return the configuration with another number at a dotted key.

    Raises
    ------
    InvalidValue
        If there is no number, it is of another kind, or the constructors do not allow this one.
    """
    here, _, below = key.partition(".")
    if not dataclasses.is_dataclass(config) or not hasattr(config, here):
        raise InvalidValue(here, "no such key", value)
    old = getattr(config, here)
    try:
        new = replaced(old, below, value) if below else _as(value, old, here)
        tree: Any = config
        changed: T = dataclasses.replace(tree, **{here: new})
        return changed
    except InvalidValue as error:
        if below and not error.key.startswith(f"{here}."):
            raise InvalidValue(f"{here}.{error.key}", error.rule, error.value) from None
        raise


def tuned(tables: Mapping[str, Any], values: Mapping[str, Value]) -> dict[str, Any]:
    """Return tables of a configuration, by name, with those of the values that are theirs.

    Raises
    ------
    InvalidValue
        If one is not allowed.
    """
    found = dict(tables)
    for key, value in values.items():
        table, _, below = key.partition(".")
        if table in found:
            found[table] = replaced(found[table], below, value)
    return found


def _as(value: Value, old: object, key: str) -> Value:
    """Return a value as the kind of number that it replaces."""
    if isinstance(old, bool):
        if value in (0, 1):
            return bool(value)
        raise InvalidValue(key, f"{value} found, 0 or 1 allowed", value)
    if isinstance(old, int):
        if value == int(value):
            return int(value)
        raise InvalidValue(key, f"{value} found, a whole number allowed", value)
    if isinstance(old, float):
        return float(value)
    raise InvalidValue(key, "is no number", value)


def problems(config: object, rules: Rules) -> list[str]:
    """Return what contradicts something else in a configuration."""
    return [f"{'.'.join(map(str, key))}: {why}" for key, why in rules(config)]


def with_values(config: T, values: Mapping[str, Value], rules: Rules) -> tuple[T, dict[str, str]]:
    """Return the configuration with other values, and why each that was left out cannot be had.

    Some are allowed only together with others, so whatever can be had in any order is.
    """
    refused: dict[str, str] = {}
    waiting = dict(values)
    while waiting:
        refused = {}
        for key, value in waiting.items():
            try:
                tried = replaced(config, key, value)
            except InvalidValue as error:
                refused[key] = str(error)
                continue
            if wrong := problems(tried, rules):
                refused[key] = "; ".join(wrong)
            else:
                config = tried
        if len(refused) == len(waiting):
            break
        waiting = {key: waiting[key] for key in refused}
    return config, refused
