"""Messages as plain JSON with a schema for plotting tools.

JSON has neither nan nor infinity, and log viewers support neither references nor alternatives in a
schema. So there is one rule: a number that is not finite is left out, like None; a list of numbers
with one that is not finite is left out as a whole.
"""

from __future__ import annotations

import enum
import math
import types
from typing import Any, Final, TypeAlias, Union, get_args, get_origin, get_type_hints

import msgspec

from robotctl.runtime.loop import SCHEDULER, STAGES

JsonSchema: TypeAlias = dict[str, Any]

_PRIMITIVES: Final[dict[type, str]] = {
    bool: "boolean",
    int: "integer",
    float: "number",
    str: "string",
}
_WHOLE: Final = frozenset({bool, int, str})
"""Types that are never left out."""


def schema_of(kind: Any, *, complete: bool = False) -> JsonSchema:
    """Return the JSON schema of a message type, or of the type of one of its fields.

    Parameters
    ----------
    kind
        Struct, primitive, enumeration, bytes, or a tuple, list or dict of them.
    complete
        Whether nothing in such a message is ever left out.

    Raises
    ------
    TypeError
        If messages cannot have the type.
    """
    if isinstance(kind, type):
        if issubclass(kind, msgspec.Struct):
            return _schema_of_struct(kind, complete=complete)
        if issubclass(kind, enum.IntEnum | enum.IntFlag):
            return {"type": "integer", "description": _words(kind)}
        if kind in _PRIMITIVES:
            return {"type": _PRIMITIVES[kind]}
        if kind is bytes:
            return {"type": "string", "contentEncoding": "base64"}
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        (present,) = (each for each in arguments if each is not type(None))
        return schema_of(present, complete=complete)
    if origin in (tuple, list):
        return {"type": "array", "items": schema_of(arguments[0], complete=complete)}
    if origin is dict:  # by stage of the control loop
        values = schema_of(arguments[1], complete=complete)
        return {"type": "object", "properties": dict.fromkeys((*STAGES, SCHEDULER), values)}
    raise TypeError(f"{kind}: no JSON schema for it")


def _schema_of_struct(kind: type[msgspec.Struct], *, complete: bool) -> JsonSchema:
    """Return the schema of a struct; fields that are always present are required."""
    hints = get_type_hints(kind)
    names = kind.__struct_fields__
    return {
        "type": "object",
        "properties": {name: schema_of(hints[name], complete=complete) for name in names},
        "required": [
            name
            for name in names
            if (complete and not _is_optional(hints[name])) or _is_always_there(hints[name])
        ],
    }


def _is_optional(kind: Any) -> bool:
    return get_origin(kind) in (Union, types.UnionType)


def _is_always_there(kind: Any) -> bool:
    """Whether `plain` never leaves out a field of this type."""
    if get_origin(kind) in (tuple, list):
        return get_args(kind)[0] is not float
    return isinstance(kind, type) and kind is not float


def _words(kind: type[enum.IntEnum | enum.IntFlag]) -> str:
    """Return the numbers of an enumeration with their names, such as `0 boot, 1 standby`."""
    return ", ".join(f"{each.value} {str(each.name).lower().replace('_', ' ')}" for each in kind)


def plain(value: Any) -> Any:
    """Return a message, or a part of it, with the names of its fields, without missing values.

    The encoder itself would write some messages without names, and null for nan and infinity. None
    is a part to leave out.
    """
    if isinstance(value, msgspec.Struct):
        content = {}
        for name in value.__struct_fields__:
            part = getattr(value, name)
            kind = type(part)
            if kind is float:
                if math.isfinite(part):
                    content[name] = part
            elif kind in _WHOLE or (part := plain(part)) is not None:
                content[name] = part
        return content
    if isinstance(value, tuple) and value:
        if isinstance(value[0], msgspec.Struct):
            return [plain(each) for each in value]
        if isinstance(value[0], float) and not all(map(math.isfinite, value)):
            return None
    return value
