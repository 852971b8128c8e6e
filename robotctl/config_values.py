"""Single values of a configuration, which is a tree of frozen dataclasses, by their dotted keys."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeAlias, TypeVar

from robotctl.errors import InvalidValue

T = TypeVar("T")

Value: TypeAlias = bool | int | float
Rules: TypeAlias = Callable[[Any], Iterable[tuple[tuple[str | int, ...], str]]]
"""Yields what no value alone shows: the key to blame and what is wrong."""


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
