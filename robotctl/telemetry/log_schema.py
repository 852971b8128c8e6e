"""Messages as plain JSON with a schema that plotting tools read.

The schemas use nothing but `type`, `properties` and `items`: no references and no alternatives,
which viewers of logs do not follow. A value that may be missing has the schema of its kind and is
null where it is missing; so are nan and infinity, for which JSON has no word.
"""

from __future__ import annotations

import enum
import types
from typing import Any, Final, TypeAlias, Union, get_args, get_origin, get_type_hints

import msgspec

Schema: TypeAlias = dict[str, Any]

_PRIMITIVES: Final[dict[type, str]] = {
    bool: "boolean",
    int: "integer",
    float: "number",
    str: "string",
}

LOG_SCHEMA: Final[Schema] = {
    "type": "object",
    "properties": {
        "timestamp": {
            "type": "object",
            "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
        },
        "level": {"type": "integer"},
        "message": {"type": "string"},
        "name": {"type": "string"},
        "file": {"type": "string"},
        "line": {"type": "integer"},
    },
}
"""`foxglove.Log`: https://docs.foxglove.dev/docs/sdk/schemas/log, what log panels show."""

_LEVELS: Final = ((3, 5), (4, 4), (5, 3), (7, 2))
"""Severity of RFC 5424 below the first number: level of `foxglove.Log`."""


def schema_of(kind: Any) -> Schema:
    """Return the JSON schema of a message type, or of the type of one of its fields.

    Raises
    ------
    TypeError
        For a type that messages do not have.
    """
    if isinstance(kind, type):
        if issubclass(kind, msgspec.Struct):
            hints = get_type_hints(kind)
            return {
                "type": "object",
                "properties": {name: schema_of(hints[name]) for name in kind.__struct_fields__},
            }
        if issubclass(kind, enum.IntEnum | enum.IntFlag):
            return {"type": "integer"}
        if kind in _PRIMITIVES:
            return {"type": _PRIMITIVES[kind]}
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        (present,) = (each for each in arguments if each is not type(None))
        return schema_of(present)
    if origin is tuple:
        return {"type": "array", "items": schema_of(arguments[0])}
    if origin is dict:
        return {"type": "object"}
    raise TypeError(f"{kind}: no JSON schema for it")


def plain(value: Any) -> Any:
    """Return a message, or a part of it, with the names of its fields, for msgspec's JSON encoder.

    The encoder itself would write the values of some messages without names; it does write nan
    and infinity as null.
    """
    if isinstance(value, msgspec.Struct):
        return {
            name: part if type(part) in _PRIMITIVES else plain(part)
            for name in value.__struct_fields__
            for part in (getattr(value, name),)
        }
    if isinstance(value, tuple) and value and isinstance(value[0], msgspec.Struct):
        return [plain(each) for each in value]
    return value


def log_entry(epoch_ns: int, severity: int, text: str, name: str) -> dict[str, Any]:
    """Return a line of text as `foxglove.Log`.

    Parameters
    ----------
    epoch_ns
        Wall time [ns since 1970].
    severity
        RFC 5424, 0 worst to 7.
    text, name
        The line, and who says it.
    """
    level = next((level for below, level in _LEVELS if severity < below), 1)
    seconds, nanoseconds = divmod(epoch_ns, 1_000_000_000)
    return {
        "timestamp": {"sec": seconds, "nsec": nanoseconds},
        "level": level,
        "message": text,
        "name": name,
        "file": "",
        "line": 0,
    }
