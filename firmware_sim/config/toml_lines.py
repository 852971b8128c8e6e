"""Positions of the keys of a TOML file, which `tomllib` does not provide."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from typing import TypeAlias

Key: TypeAlias = tuple[str | int, ...]
"""`("sonar", 2, "x_m")`: names of tables and keys, indices of lists."""

_HEADER = re.compile(r"^\s*(\[\[?)\s*([^\]]+?)\s*\]")
_ASSIGNMENT = re.compile(r"^\s*([A-Za-z0-9_.\"'-]+)\s*=")
_CLOSES = re.compile(r"[\]}\"']\s*(?:#.*)?$")


def key_lines(text: str) -> dict[Key, int]:
    """Map tables and keys of a valid file's text to their lines, counted from 1."""
    return dict(reversed(list(_keys(text))))


def _keys(text: str) -> Iterator[tuple[Key, int]]:
    table: Key = ()
    last: dict[Key, int] = {}
    rows = enumerate(text.splitlines(), 1)
    for number, row in rows:
        if header := _HEADER.match(row):
            table = _table(header[2], last, is_new=header[1] == "[[")
            yield table, number
        elif assignment := _ASSIGNMENT.match(row):
            yield (*table, *_parts(assignment[1])), number
            _skip(row, rows)


def _table(name: str, last: dict[Key, int], *, is_new: bool) -> Key:
    """Return a header's key with the indices of the lists in it; `last` holds those so far."""
    parts = _parts(name)
    key: Key = ()
    for count, part in enumerate(parts, 1):
        key = (*key, part)
        if is_new and count == len(parts):
            last[key] = last.get(key, -1) + 1
        if key in last:
            key = (*key, last[key])
    return key


def _parts(name: str) -> list[str]:
    return [part.strip().strip("\"'") for part in name.split(".")]


def _skip(row: str, rows: Iterator[tuple[int, str]]) -> None:
    """Skip the further lines of a value that begins in a row; they may look like headers."""
    while not _is_complete(row):
        for _, more in rows:
            row += f"\n{more}"
            if _CLOSES.search(more):
                break
        else:
            return


def _is_complete(assignment: str) -> bool:
    try:
        tomllib.loads(assignment)
    except (ValueError, RecursionError):
        return False
    return True
