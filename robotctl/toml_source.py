"""TOML files as frozen dataclasses: every error of a file at once, with its line and nearest name.

`tomllib` keeps no positions, so a small scan of the text finds the line of each key again. What
checks a file, pydantic, is loaded with the first one: the processes of a robot get what one of them
has read, and `restored` makes it the same dataclass again in a tenth of the time.
"""

from __future__ import annotations

import dataclasses
import datetime as dt
import difflib
import json
import operator
import re
import reprlib
import tomllib
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, TypeVar

from robotctl.errors import ConfigError, InvalidValue

if TYPE_CHECKING:
    import pydantic

T = TypeVar("T")
Key = tuple[str | int, ...]

Rules = Callable[[T], Iterable[tuple[Key, str]]]
"""Yields errors between keys: the key to blame and the problem."""


class _ByKind:
    """Marks a union of tables that their key `kind` tells apart."""

    def __get_pydantic_core_schema__(
        self, kind: Any, handler: pydantic.GetCoreSchemaHandler
    ) -> Any:
        from pydantic import Field  # noqa: PLC0415 - with the first file

        return handler.generate_schema(Annotated[kind, Field(discriminator="kind")])


class _TableOrTables:
    """Marks a union of a table, `[name]`, and of several, `[[name]]` each."""

    def __get_pydantic_core_schema__(
        self, kind: Any, handler: pydantic.GetCoreSchemaHandler
    ) -> Any:
        from pydantic import Discriminator, Tag  # noqa: PLC0415 - with the first file

        table, tables = typing.get_args(kind)
        each = Annotated[table, Tag("table")], Annotated[tables, Tag("tables")]
        either: Any = operator.or_(*each)
        return handler.generate_schema(Annotated[either, Discriminator(_table_or_tables)])


def _table_or_tables(value: object) -> str:
    return "tables" if isinstance(value, list | tuple) else "table"


BY_KIND: Final = _ByKind()
TABLE_OR_TABLES: Final = _TableOrTables()

_HEADER = re.compile(r"^\s*(\[\[?)\s*([^\]]+?)\s*\]\]?\s*(?:#.*)?$")
_ASSIGNMENT = re.compile(r"^\s*([A-Za-z0-9_\-\"'.]+)\s*=")
_INDEX = re.compile(r"\[(\d+)\]")
_BARE = re.compile(
    r"""(?<=[\[,={\s])[^\s"'\[\]{},=](?:[^"'\[\]{},=]*[^\s"'\[\]{},=])?(?=\s*[,\]}])"""
)
"""A value of a list or table without quotes."""
_END_OF_VALUE = re.compile(r"[\]}\"']\s*(?:#.*)?$")


def load(
    path: Path, kind: type[T], overrides: Sequence[str] = (), rules: Rules[T] | None = None
) -> T:
    """Read `path` into the dataclass `kind`, after applying `overrides` (`a.b.c=value`).

    Raises
    ------
    ConfigError
        One line for each error: `FILE:LINE: key: what is allowed, found X; did you mean "..."?`,
        with the line of the key, or of its table where it has its default; `--set SETTING` in the
        place of file and line where the user set it.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}{_near_file(path)}") from error
    return parse(text, kind, str(path), overrides, rules)


def parse(
    text: str,
    kind: type[T],
    name: str,
    overrides: Sequence[str] = (),
    rules: Rules[T] | None = None,
) -> T:
    """Turn the TOML `text` of a file called `name` into the dataclass `kind`, as `load`."""
    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError: also for absurdly long numbers
        raise ConfigError(f"{name}: not valid TOML: {error}") from error
    lines = _key_lines(text)
    sources = {key: f"{name}:{line}" for key, line in lines.items()}
    made: dict[Key, str] = {}  # a key missing in such a table is blamed on the file
    impossible: list[str] = []
    for override in overrides:
        try:
            key, tables = _apply_override(data, override)
        except ConfigError as error:
            impossible.append(str(error))
            continue
        sources[key] = f"--set {override}"
        made |= dict.fromkeys(tables, f"--set {override}")

    def refuse(problems: Iterable[tuple[Key, str]]) -> None:
        lines = [
            f"{made.get(key) or _place(key, sources, name)}: {_dotted(key)}: {why}"
            for key, why in problems
        ]
        if impossible or lines:
            raise ConfigError("\n".join((*impossible, *lines)))

    dates = dict(_dates(data, ()))
    refuse(
        (
            *_unknown_keys(data, kind, ()),
            *dates.items(),
            *(problem for problem in _invalid_values(data, kind) if problem[0] not in dates),
        )
    )
    value = validator(kind).validate_json(json.dumps(data), strict=True)
    if rules is not None:
        refuse(rules(value))
    return value


def is_utf_8(text: str) -> bool:
    """Return whether a text can be encoded; an argument of other bytes cannot."""
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def nearest(word: str, allowed: Sequence[str]) -> str:
    """Return `; did you mean "..."?` for the name nearest to `word`, else what is allowed."""
    return _meant(word, allowed) or (f"; allowed: {', '.join(sorted(allowed))}" if allowed else "")


def _meant(word: str, allowed: Sequence[str]) -> str:
    """Return `; did you mean "..."?` for a name that is much like `word`; empty: none is."""
    match = difflib.get_close_matches(word, allowed, n=1, cutoff=0.5)
    return f'; did you mean "{match[0]}"?' if match else ""


def _near_file(path: Path) -> str:
    """Suggest a file beside `path` with a similar name."""
    if path.exists() or not path.parent.is_dir():
        return ""
    return nearest(path.name, [p.name for p in path.parent.glob("*.toml")])


_VALIDATORS: dict[type[Any], pydantic.TypeAdapter[Any]] = {}


def validator(kind: type[T]) -> pydantic.TypeAdapter[T]:
    """Return pydantic's validator of a dataclass; a robot's takes 50 ms to build."""
    import pydantic  # noqa: PLC0415 - with the first file

    if kind not in _VALIDATORS:
        _VALIDATORS[kind] = pydantic.TypeAdapter(kind)
    return _VALIDATORS[kind]


def restored(kind: Any, data: Any) -> Any:
    """Return a dataclass that was read before, from its plain data.

    Parameters
    ----------
    kind
        Type of the value: the dataclass, or of one of its fields.
    data
        Its fields by name, as they were in JSON. Fields that `kind` does not have are left out.

    Raises
    ------
    ConfigError
        If they do not fit: another version made them.
    """
    if data is None and type(None) in typing.get_args(kind):
        return None
    kind = _dataclass_of(data, kind)
    if _is_dataclass(kind) and isinstance(data, dict):
        hints = _hints(kind)
        fields = (field.name for field in dataclasses.fields(kind) if field.name in data)
        try:
            return kind(**{name: restored(hints[name], data[name]) for name in fields})
        except (TypeError, ValueError) as error:
            raise ConfigError(f"{kind.__name__}: {error}") from error
    if isinstance(data, list) and typing.get_origin(kind) is tuple:
        kinds = typing.get_args(kind)
        if kinds[-1] is Ellipsis:
            kinds = (kinds[0],) * len(data)
        return tuple(map(restored, kinds, data))
    if kind is float and type(data) is int:
        return float(data)
    if kind is None:
        raise ConfigError(f"{shown(data)} found, of no kind that this version knows")
    if (kind in _PLAIN and type(data) is not kind) or _is_dataclass(kind):
        raise ConfigError(f"{kind.__name__} needed, found {shown(data)}")
    return data


_PLAIN: Final = (bool, int, float, str)


@cache
def _hints(kind: type[Any]) -> dict[str, Any]:
    """Return the types of a dataclass's fields."""
    return typing.get_type_hints(kind, include_extras=True)


def _invalid_values(data: dict[str, Any], kind: type[Any]) -> Iterator[tuple[Key, str]]:
    """Yield the errors of pydantic and of the dataclasses' constructors."""
    import pydantic  # noqa: PLC0415 - with the first file

    try:
        validator(kind).validate_json(json.dumps(data, default=str), strict=True)
    except pydantic.ValidationError as error:
        for item in error.errors(include_url=False):
            yield from _problems(item, data, kind)


def _dates(data: Any, at: Key) -> Iterator[tuple[Key, str]]:
    """Yield dates and times, which no key accepts."""
    if isinstance(data, dict | list):
        for key, value in data.items() if isinstance(data, dict) else enumerate(data):
            yield from _dates(value, (*at, key))
    elif isinstance(data, dt.date | dt.time):
        yield at, f"must be no date or time, found {data}"


def _problems(item: Mapping[str, Any], data: Any, kind: Any) -> Iterator[tuple[Key, str]]:
    """Yield the problems in an error of pydantic."""
    what, found, context = item["type"], item["input"], item.get("ctx", {})
    key = _data_key(item["loc"], data, missing=what == "missing")
    if what == "missing":
        yield key, "missing key, it has no default"
    elif what.startswith("union_tag_"):
        key = (*key, context["discriminator"].strip("'"))
        if what == "union_tag_not_found":
            yield key, "missing key, it has no default"
        else:
            yield key, f"must be one of {context['expected_tags']}, found {context['tag']!r}"
    elif what == "value_error":
        yield _blamed(key, context["error"], data, kind)
    else:
        message, hint = item["msg"], ""
        if what == "literal_error" and isinstance(found, str):
            hint = _meant(found, context["expected"].split("'")[1::2])
        yield key, f"{message[:1].lower()}{message[1:]}, found {shown(found)}{hint}"


def _blamed(at: Key, error: ValueError, data: Any, kind: Any) -> tuple[Key, str]:
    """Return the key that a constructor blames, and why.

    Its table, `at`, and the whole message if it blames none of the table's keys.
    """
    if not isinstance(error, InvalidValue):
        return at, str(error)
    table, table_kind = data, _dataclass_of(data, kind)
    for part in at:
        table, table_kind = _step(table, table_kind, part)
    key: Key = at
    for part in error.key.split("."):
        if not _has(table, table_kind, part):
            return at, str(error)
        table, table_kind = _step(table, table_kind, part)
        key = (*key, part)
    return key, error.rule


def _has(table: Any, kind: Any, part: str) -> bool:
    """Whether a table has or may have a key."""
    names = [each.name for each in dataclasses.fields(kind)] if _is_dataclass(kind) else []
    return part in names or (isinstance(table, dict) and part in table)


def _step(table: Any, kind: Any, part: str | int) -> tuple[Any, Any]:
    """Return value and type of a key of a table, with its default if absent."""
    inner: Any = None
    if isinstance(part, int):
        inner = next(iter(typing.get_args(kind)), None)
    elif _is_dataclass(kind):
        inner = _hints(kind).get(part)
    try:
        value = table[part]
    except (KeyError, IndexError, TypeError):
        value = _default(kind, part)
    return value, _dataclass_of(value, inner)


def _default(kind: Any, part: str | int) -> Any:
    """Return the default of a field; None without one, or if it is a table."""
    fields = dataclasses.fields(kind) if _is_dataclass(kind) else ()
    values = [each.default for each in fields if each.name == part]
    return None if not values or values[0] is dataclasses.MISSING else values[0]


def _is_dataclass(kind: Any) -> bool:
    return isinstance(kind, type) and dataclasses.is_dataclass(kind)


def shown(value: Any) -> str:
    """Return a value as shown in errors: short, a table without its content."""
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, bool):
        return str(value).lower()
    return reprlib.repr(value)


def _data_key(location: tuple[str | int, ...], data: Any, *, missing: bool) -> Key:
    """Return pydantic's location without the names of union members, which are not keys."""
    key: list[str | int] = []
    for position, part in enumerate(location):
        try:
            data = data[part]
        except (KeyError, IndexError, TypeError):
            if not (missing and position == len(location) - 1):
                continue
        key.append(part)
    return tuple(key)


def _unknown_keys(data: Any, kind: Any, at: Key) -> Iterator[tuple[Key, str]]:
    """Yield keys that no dataclass of `kind` has, with the nearest valid one."""
    kind = _dataclass_of(data, kind)
    if isinstance(data, list):
        item = next(iter(typing.get_args(kind)), None)
        for index, value in enumerate(data):
            yield from _unknown_keys(value, item, (*at, index))
    elif _is_dataclass(kind) and isinstance(data, dict):
        hints = _hints(kind)
        fields = [field.name for field in dataclasses.fields(kind)]
        for key, value in data.items():
            if key not in fields:
                yield (*at, key), f"unknown key{nearest(key, fields)}"
            else:
                yield from _unknown_keys(value, hints[key], (*at, key))


def _dataclass_of(data: Any, kind: Any) -> Any:
    """Resolve annotations and unions to the type that fits `data`.

    The `kind` selects among dataclasses, None if there is none of it; a list selects the tuple.
    """
    while typing.get_origin(kind) is typing.Annotated:
        kind = typing.get_args(kind)[0]
    if typing.get_origin(kind) not in (typing.Union, types.UnionType):
        return kind
    members = [_dataclass_of(data, member) for member in typing.get_args(kind)]
    if isinstance(data, list):
        return next((each for each in members if typing.get_origin(each) is tuple), None)
    dataclass_members = [member for member in members if _is_dataclass(member)]
    if not dataclass_members:
        return kind
    if len(dataclass_members) == 1:
        return dataclass_members[0]
    for member in dataclass_members:
        hints = _hints(member)
        if isinstance(data, dict) and data.get("kind") in typing.get_args(hints.get("kind")):
            return member
    return None


def _split_override(override: str) -> tuple[list[str], Any]:
    """Return the parts of the key of `a.b.c=value`, and the value."""
    path, separator, text = override.partition("=")
    if not separator or not path.strip():
        raise ConfigError(f"--set {override}: not of the form key.subkey=value")
    if (spelled := _INDEX.sub(r".\1", path)) != path:
        raise ConfigError(f"--set {override}: {path} found, write {spelled}")
    if not is_utf_8(override):
        raise ConfigError(f"--set {override}: not UTF-8")
    return [part.strip() for part in path.split(".")], _override_value(text)


def _override_value(text: str) -> Any:
    """Return a value in TOML whose quotes a shell may have taken: bare words are strings."""
    for spelled in (text, _BARE.sub(_quoted, text)):
        with suppress(ValueError, RecursionError):
            return tomllib.loads(f"value = {spelled}")["value"]
    return text


def _quoted(word: re.Match[str]) -> str:
    """Return a word of a list or table in quotes, unless it is a value without quotes."""
    with suppress(ValueError):
        tomllib.loads(f"value = {word[0]}")
        return word[0]
    return json.dumps(word[0], ensure_ascii=False)


def _apply_override(data: dict[str, Any], override: str) -> tuple[Key, list[Key]]:
    """Set `a.b.c=value` in `data`; the value is TOML, or a bare word as a string.

    Returns the key of the value, and those of the tables that were created.
    """
    parts, value = _split_override(override)
    key: list[str | int] = []
    made: list[Key] = []
    target: Any = data
    for position, part in enumerate(parts):
        last = position == len(parts) - 1
        if not isinstance(target, dict | list):
            above = _dotted(tuple(key))
            raise ConfigError(
                f"--set {override}: {above} is {shown(target)}, which has no keys below it"
            )
        index: Any = int(part) if isinstance(target, list) and part.isdigit() else part
        key.append(index)
        try:
            if last:
                target[index] = value
            elif isinstance(target, list):
                target = target[index]
            else:
                if index not in target:
                    made.append(tuple(key))
                target = target.setdefault(index, {})
        except (TypeError, IndexError) as error:
            raise ConfigError(
                f"--set {override}: {_dotted(tuple(key))}: no such key{_entries(target, key[:-1])}"
            ) from error
    return tuple(key), made


def _entries(target: Any, key: list[str | int]) -> str:
    """Return the names of a list's entries as a hint; empty for other values."""
    if not isinstance(target, list) or not target:
        return ""
    first = ".".join(map(str, [*key, 0]))
    last = ".".join(map(str, [*key, len(target) - 1]))
    return f"; its entries are {first}" + (f" to {last}" if first != last else "")


def _key_lines(text: str) -> dict[Key, int]:
    """Map each table and key of the TOML `text` to its line, counted from 1."""
    lines: dict[Key, int] = {}
    table: Key = ()
    counts: dict[Key, int] = {}
    rest = enumerate(text.splitlines(), 1)
    for number, line in rest:
        if header := _HEADER.match(line):
            table = _resolve(_split(header[2]), counts, append=header[1] == "[[")
            lines.setdefault(table, number)
            if isinstance(table[-1], int):
                lines.setdefault(table[:-1], number)  # a list begins with its first table
        elif assignment := _ASSIGNMENT.match(line):
            lines.setdefault((*table, *_split(assignment[1])), number)
            _pass_value(line, rest)
    return lines


def _pass_value(first: str, rest: Iterator[tuple[int, str]]) -> None:
    """Skip the further lines of a value that begins in a line; they may look like headers."""
    value = first
    while not _is_whole(value):
        for _, line in rest:
            value = f"{value}\n{line}"
            if _END_OF_VALUE.search(line):
                break
        else:
            return


def _is_whole(text: str) -> bool:
    try:
        tomllib.loads(text)
    except (ValueError, RecursionError):
        return False
    return True


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
    """Return a key as shown in errors: `sonar[2].x_m`."""
    text = ""
    for part in key:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text or "(whole file)"
