"""Messages as plain JSON with a schema that plotting tools read.

The schemas use nothing but `type`, `properties` and `items`: no references and no alternatives,
which viewers of logs do not follow. A value that may be missing has the schema of its kind and is
null where it is missing; so are nan and infinity, for which JSON has no word.
"""

from __future__ import annotations

import enum
import sys
import types
from array import array
from typing import Any, Final, TypeAlias, Union, get_args, get_origin, get_type_hints

import msgspec

from robotctl.runtime.estimation_messages import LidarScan

Schema: TypeAlias = dict[str, Any]

_PRIMITIVES: Final[dict[type, str]] = {
    bool: "boolean",
    int: "integer",
    float: "number",
    str: "string",
}

_TIME: Final[Schema] = {
    "type": "object",
    "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
}

_NUMBER: Final[Schema] = {"type": "number"}
_NUMBERS: Final[Schema] = {"type": "array", "items": _NUMBER}


def _object(**properties: Schema) -> Schema:
    return {"type": "object", "properties": properties}


LASER_SCHEMA: Final[Schema] = _object(
    timestamp=_TIME,
    frame_id={"type": "string"},
    pose=_object(
        position=_object(x=_NUMBER, y=_NUMBER, z=_NUMBER),
        orientation=_object(x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER),
    ),
    start_angle=_NUMBER,
    end_angle=_NUMBER,
    ranges=_NUMBERS,
    intensities=_NUMBERS,
    max_range=_NUMBER,
)
"""`foxglove.LaserScan`: https://docs.foxglove.dev/docs/sdk/schemas/laser-scan, and `max_range`.

A beam that nothing came back to is null."""

LOG_SCHEMA: Final[Schema] = {
    "type": "object",
    "properties": {
        "timestamp": _TIME,
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
    return {
        "timestamp": _time(epoch_ns),
        "level": level,
        "message": text,
        "name": name,
        "file": "",
        "line": 0,
    }


def laser_scan(epoch_ns: int, scan: LidarScan) -> dict[str, Any]:
    """Return a scan as `foxglove.LaserScan` in the frame `base`, taken at a wall time [ns]."""
    ranges = array("f", scan.ranges)
    if sys.byteorder == "big":
        ranges.byteswap()
    return {
        "timestamp": _time(epoch_ns),
        "frame_id": "base",
        "pose": {
            "position": {"x": scan.x_m, "y": scan.y_m, "z": 0.0},
            "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
        },
        "start_angle": scan.first_rad,
        "end_angle": scan.first_rad + scan.step_rad * (len(ranges) - 1),
        "ranges": [round(range_m, 4) for range_m in ranges],
        "intensities": [],
        "max_range": scan.max_range_m,
    }


def _time(epoch_ns: int) -> dict[str, int]:
    seconds, nanoseconds = divmod(epoch_ns, 1_000_000_000)
    return {"sec": seconds, "nsec": nanoseconds}
