"""Configuration patches: tables of a robot's file, as TOML and as arguments of `--set`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import TypeAlias

Value: TypeAlias = int | float | list[float]
Tables: TypeAlias = Mapping[str, Mapping[str, Value]]
"""Table, key and value."""


def round_figures(value: float, figures: int) -> float:
    """Return a value rounded to some significant figures."""
    if value == 0.0 or not math.isfinite(value):
        return value
    return round(value, figures - 1 - math.floor(math.log10(abs(value))))


def as_overrides(tables: Tables) -> list[str]:
    """Return the values as arguments of `--set`."""
    return [
        f"{table}.{key}={value!r}"
        for table, values in tables.items()
        for key, value in values.items()
    ]


def as_toml(tables: Tables, comments: Iterable[str], words: Callable[[str, str], str]) -> str:
    """Return the tables as TOML.

    Parameters
    ----------
    tables
        Values by table and key.
    comments
        Comment lines above.
    words
        Comment beside the value of a table and key; "" for none.
    """
    lines = [f"# {comment}".rstrip() for comment in comments]
    for table, values in tables.items():
        lines += ["", f"[{table}]"]
        for key, value in values.items():
            said = words(table, key)
            text = f"{key} = {value!r}"
            lines.append(f"{text:<32}# {said}" if said else text)
    return "\n".join(lines) + "\n"
