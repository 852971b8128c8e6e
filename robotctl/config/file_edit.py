"""Changes of single values in a robot's file, which keep its comments and order."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import tomlkit
from tomlkit.items import AoT

from robotctl.errors import ConfigError

Key: TypeAlias = tuple[str | int, ...]


class Change(NamedTuple):
    """A new value of a key.

    Attributes
    ----------
    key
        Tables, places in lists and key: `("motor", 0, "axes", 1, "reversed")`.
    value
        New value; None removes the key. A list of mappings makes a new list of tables.
    comment
        Comment after the value in the file; empty: unchanged.
    """

    key: Key
    value: Any
    comment: str = ""


def edit(text: str, changes: Iterable[Change]) -> tuple[str, tuple[Change, ...]]:
    """Return the TOML `text` with changes, and the changes that undo them, in their order.

    Raises
    ------
    ConfigError
        If a key leads through a value that is no table.
    """
    document = tomlkit.parse(text)
    undo: list[Change] = []
    for change in changes:
        undo.insert(0, _apply(document, change))
    return tomlkit.dumps(document).rstrip("\n") + "\n", tuple(undo)


def _apply(document: tomlkit.TOMLDocument, change: Change) -> Change:
    """Make a change; return the one that undoes it."""
    key, value, comment = change
    *tables, last = key
    holder: Any = document
    for place, part in enumerate(tables):
        if hasattr(holder, "keys") and part not in holder:
            if value is None:
                return change
            holder[part] = tomlkit.table()
            made = tuple(tables[: place + 1])
            _set(holder[part], key[place + 1 :], value, comment)
            return Change(made, None)
        try:
            holder = holder[part]
        except (LookupError, TypeError) as error:
            raise _no_key(key) from error
    if not hasattr(holder, "keys"):
        raise _no_key(key)
    before = Change(key, _plain(holder[last]) if last in holder else None)
    if value is not None:
        _set(holder, (last,), value, comment)
    elif last in holder:
        del holder[last]
    return before


def _no_key(key: Key) -> ConfigError:
    return ConfigError(f"{'.'.join(map(str, key))}: no such key in the file")


def _set(holder: Any, key: Key, value: Any, comment: str) -> None:
    """Set a value below a table; creates tables in between."""
    *tables, last = key
    for part in tables:
        holder[part] = tomlkit.table()
        holder = holder[part]
    holder[last] = _tables(value) if _is_tables(value) else value
    if comment:
        holder[last].comment(comment)


def _is_tables(value: Any) -> bool:
    return isinstance(value, Sequence) and bool(value) and isinstance(value[0], Mapping)


def _tables(values: Sequence[Mapping[str, Any]]) -> AoT:
    """Return a list of tables, with their own lists of tables as one line each."""
    tables = tomlkit.aot()
    for each in values:
        table = tomlkit.table()
        for key, value in each.items():
            table[key] = _lines(value) if _is_tables(value) else value
        tables.append(table)
    return tables


def _lines(values: Sequence[Mapping[str, Any]]) -> tomlkit.items.Array:
    """Return a list of tables with a line for each."""
    array = tomlkit.array().multiline(multiline=True)
    for each in values:
        line = tomlkit.inline_table()
        line.update(each)
        array.append(line)
    return array


def _plain(value: Any) -> Any:
    """Return a value as plain Python."""
    return value.unwrap() if hasattr(value, "unwrap") else value
