"""TOML files as frozen dataclasses: every error of a file at once, with its line and nearest name.

`tomllib` keeps no positions, so a small scan of the text finds the line of each key again.
"""

from __future__ import annotations

import dataclasses
import difflib
import json
import re
import tomllib
import types
import typing
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

import pydantic

from robotctl.errors import ConfigError

T = TypeVar("T")
Key = tuple[str | int, ...]

_HEADER = re.compile(r"^\s*(\[\[?)\s*([^\]]+?)\s*\]\]?\s*(?:#.*)?$")
_ASSIGNMENT = re.compile(r"^\s*([A-Za-z0-9_\-\"'.]+)\s*=")


def load(path: Path, kind: type[T], overrides: Sequence[str] = ()) -> T:
    """Read `path` into the dataclass `kind`, after applying `overrides` (`a.b.c=value`).

    Raises
    ------
    ConfigError
        One line for each error: `FILE:LINE: key: what is wrong; did you mean "..."?`
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}{_near_file(path)}") from error
    return parse(text, kind, str(path), overrides)


def parse(text: str, kind: type[T], name: str, overrides: Sequence[str] = ()) -> T:
    """Turn the TOML `text` of a file called `name` into the dataclass `kind`, as `load`."""
    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError: numbers beyond all sense too
        raise ConfigError(f"{name}: not valid TOML: {error}") from error
    lines = _key_lines(text)
    sources = {key: f"{name}:{line}" for key, line in lines.items()}
    for override in overrides:
        key = _apply_override(data, override)
        sources[key] = f"--set {override}"
    problems = [
        f"{_place(key, sources, name)}: {_dotted(key)}: {problem}"
        for key, problem in (*_unknown_keys(data, kind, ()), *_invalid_values(data, kind))
    ]
    if problems:
        raise ConfigError("\n".join(problems))
    return _adapter(kind).validate_json(json.dumps(data), strict=True)


def nearest(word: str, allowed: Sequence[str]) -> str:
    """Return `; did you mean "..."?` for the name nearest to `word`, else what is allowed."""
    match = difflib.get_close_matches(word, allowed, n=1, cutoff=0.5)
    if match:
        return f'; did you mean "{match[0]}"?'
    return f"; allowed: {', '.join(sorted(allowed))}" if allowed else ""


def _near_file(path: Path) -> str:
    """Suggest a file beside `path` with a similar name."""
    if path.exists() or not path.parent.is_dir():
        return ""
    return nearest(path.name, [p.name for p in path.parent.glob("*.toml")])


def _adapter(kind: type[T]) -> pydantic.TypeAdapter[T]:
    """Return pydantic's validator of a dataclass."""
    return pydantic.TypeAdapter(kind)


def _invalid_values(data: dict[str, Any], kind: type[Any]) -> Iterator[tuple[Key, str]]:
    """Yield what pydantic and the constructors of the dataclasses refuse."""
    try:
        _adapter(kind).validate_json(json.dumps(data, default=str), strict=True)
    except pydantic.ValidationError as error:
        for item in error.errors(include_url=False):
            key = _data_key(item["loc"], data)
            if item["type"] == "missing":
                yield key, "missing key, it has no default"
            else:
                message = item["msg"].removeprefix("Value error, ")
                shown = item["input"]
                found = f"; found {shown!r}" if not isinstance(shown, dict | list) else ""
                yield key, f"{message[:1].lower()}{message[1:]}{found}"


def _data_key(location: tuple[str | int, ...], data: Any) -> Key:
    """Drop from pydantic's location the names of union members, which are no keys of the file."""
    key: list[str | int] = []
    for position, part in enumerate(location):
        try:
            data = data[part]
        except (KeyError, IndexError, TypeError):
            if position < len(location) - 1:
                continue
        key.append(part)
    return tuple(key)


def _unknown_keys(data: Any, kind: Any, at: Key) -> Iterator[tuple[Key, str]]:
    """Yield keys that no dataclass of `kind` has, with the nearest one that it has."""
    kind = _dataclass_of(data, kind)
    if isinstance(data, list):
        item = next(iter(typing.get_args(kind)), None)
        for index, value in enumerate(data):
            yield from _unknown_keys(value, item, (*at, index))
    elif dataclasses.is_dataclass(kind) and isinstance(data, dict):
        hints = typing.get_type_hints(kind, include_extras=True)
        fields = [field.name for field in dataclasses.fields(kind)]
        for key, value in data.items():
            if key not in fields:
                yield (*at, key), f"unknown key{nearest(key, fields)}"
            else:
                yield from _unknown_keys(value, hints[key], (*at, key))


def _dataclass_of(data: Any, kind: Any) -> Any:
    """Resolve annotations and unions (by their `kind` field) to the type that fits `data`."""
    while typing.get_origin(kind) is typing.Annotated:
        kind = typing.get_args(kind)[0]
    if typing.get_origin(kind) not in (typing.Union, types.UnionType):
        return kind
    members = [_dataclass_of(data, member) for member in typing.get_args(kind)]
    dataclass_members = [member for member in members if dataclasses.is_dataclass(member)]
    if len(dataclass_members) == 1:
        return dataclass_members[0]
    for member in dataclass_members:
        hints = typing.get_type_hints(member)
        if isinstance(data, dict) and data.get("kind") in typing.get_args(hints.get("kind")):
            return member
    return None


def _apply_override(data: dict[str, Any], override: str) -> Key:
    """Set `a.b.c=value` in `data`; the value is TOML, or a bare word as a string."""
    path, separator, text = override.partition("=")
    if not separator or not path.strip():
        raise ConfigError(f"--set {override}: not of the form key.subkey=value")
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        value = text
    key: list[str | int] = []
    target: Any = data
    parts = [part.strip() for part in path.split(".")]
    for position, part in enumerate(parts):
        last = position == len(parts) - 1
        index: Any = int(part) if isinstance(target, list) and part.isdigit() else part
        key.append(index)
        try:
            if last:
                target[index] = value
            elif isinstance(target, list):
                target = target[index]
            else:
                target = target.setdefault(index, {})
        except (TypeError, IndexError) as error:
            raise ConfigError(f"--set {override}: {_dotted(tuple(key))}: no such key") from error
    return tuple(key)


def _key_lines(text: str) -> dict[Key, int]:
    """Map each table and key of the TOML `text` to its line, counted from 1."""
    lines: dict[Key, int] = {}
    table: Key = ()
    counts: dict[Key, int] = {}
    for number, line in enumerate(text.splitlines(), 1):
        if header := _HEADER.match(line):
            table = _resolve(_split(header[2]), counts, append=header[1] == "[[")
            lines.setdefault(table, number)
        elif assignment := _ASSIGNMENT.match(line):
            lines.setdefault((*table, *_split(assignment[1])), number)
    return lines


def _resolve(parts: Key, counts: dict[Key, int], *, append: bool) -> Key:
    """Insert the indices of arrays of tables into a header's name; `[[x]]` starts a new element."""
    key: Key = ()
    for position, part in enumerate(parts):
        key = (*key, part)
        if append and position == len(parts) - 1:
            counts[key] = counts.get(key, -1) + 1
        if key in counts:
            key = (*key, counts[key])
    return key


def _split(dotted: str) -> Key:
    """Split a dotted TOML key without quotes."""
    return tuple(part.strip().strip("\"'") for part in dotted.split("."))


def _place(key: Key, sources: dict[Key, str], name: str) -> str:
    """Return the place of `key`, or of the nearest table around it."""
    while key:
        if key in sources:
            return sources[key]
        key = key[:-1]
    return name


def _dotted(key: Key) -> str:
    """Write a key as the user writes it: `sonar[2].x_m`."""
    text = ""
    for part in key:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text or "(whole file)"
