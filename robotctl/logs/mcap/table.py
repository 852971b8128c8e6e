"""Logged messages as rows of a table: one column for each number or text in a message.

The name of a column is the path to the value, such as `T_odom_base.x_m`, `duty[0]`, or
`sonars[front].range_m` where the parts of a list have names. What is missing has no value; what is
infinite is inf, and so is a range without an echo. Units are in the names, or follow them.
"""

from __future__ import annotations

import math
import re
import struct
from base64 import b64decode
from collections.abc import Iterable, Iterator
from typing import Any, Final, TypeAlias

from robotctl.logs.mcap.foxglove import OUT_OF_RANGE_M

Cell: TypeAlias = float | int | bool | str
Row: TypeAlias = dict[str, Cell]

_NAMES: Final = ("name", "child_frame_id")
"""Field that identifies the parts of a list, if any."""

_PASSED_OVER: Final = ("timestamp", "data", "fields")
"""Fields without a column: the time of the message itself; bytes, and their layout."""

_SUFFIXES: Final = {
    "_rad_s": "rad/s",
    "_m_s": "m/s",
    "_rad": "rad",
    "_hz": "Hz",
    "_ns": "ns",
    "_us": "us",
    "_ms": "ms",
    "_m": "m",
    "_s": "s",
    "_v": "V",
    "_a": "A",
    "_c": "degC",
}
_FOXGLOVE: Final = {
    "x": "m",
    "y": "m",
    "z": "m",
    "theta": "rad",
    "ranges": "m",
    "max_range": "m",
    "start_angle": "rad",
    "end_angle": "rad",
}
"""Units of names in foreign schemas."""

_ROTATIONS: Final = ("orientation", "rotation")
_FIGURE: Final = re.compile(r"_(p\d+|max)$")
_INDEX: Final = re.compile(r"\[[^\]]*\]")
_PACKED: Final = {1: "B", 2: "b", 3: "H", 4: "h", 5: "I", 6: "i", 7: "f", 8: "d"}
"""`foxglove.NumericType` as formats of `struct`."""


def unit_of(column: str) -> str:
    """Return the unit of a column; empty if it has none, or is text."""
    *before, last = _INDEX.sub("", column).split(".")
    if before and before[-1] in _ROTATIONS:
        return ""
    return _own_unit(last) or _FOXGLOVE.get(last) or (_own_unit(before[-1]) if before else "")


def header_of(column: str) -> str:
    """Return the header of a column: its name, with the unit unless the name has it."""
    unit = unit_of(column)
    is_told = _own_unit(_INDEX.sub("", column).rpartition(".")[2])
    return column if is_told or not unit else f"{column} [{unit}]"


def _own_unit(name: str) -> str:
    """Return the unit in the suffix of a name; empty without one."""
    stem = _FIGURE.sub("", name)
    return next((unit for suffix, unit in _SUFFIXES.items() if stem.endswith(suffix)), "")


def rows_of(message: dict[str, Any]) -> Iterable[Row]:
    """Return the rows of one message: one, one for each point of a cloud, none for a drawing."""
    if "entities" in message:
        return ()
    if "point_stride" in message:
        return _points(message)
    row: Row = {}
    _add_object(message, "", row)
    return (row,)


def _add_object(value: dict[str, Any], path: str, row: Row) -> None:
    """Add the values of an object."""
    for name, part in value.items():
        if name == "out_of_range":
            if part:
                row[f"{path}range_m"] = math.inf
        elif name not in _PASSED_OVER:
            _add(part, f"{path}{name}", row)


def _add(value: Any, path: str, row: Row) -> None:
    """Add a value, with nested ones."""
    if isinstance(value, dict):
        _add_object(value, f"{path}.", row)
    elif isinstance(value, list | tuple):
        parts = map(_range, value) if path == "ranges" else value
        for index, part in enumerate(parts):
            if isinstance(part, dict):
                named = {**part}
                names = [named.pop(key) for key in _NAMES if key in part]
                _add_object(named, f"{path}[{names[0] if names else index}].", row)
            else:
                _add(part, f"{path}[{index}]", row)
    elif value is not None:
        row[path] = value


def _range(written: float | None) -> float | None:
    """Return a range of a scan [m]; inf: no echo, None: no valid reading."""
    if written is None or written <= -OUT_OF_RANGE_M:
        return None
    return math.inf if written >= OUT_OF_RANGE_M else written


def _points(message: dict[str, Any]) -> Iterator[Row]:
    """Yield the points of a cloud."""
    data, stride = b64decode(message["data"]), message["point_stride"]
    fields = [
        (each["name"], struct.Struct("<" + _PACKED[each["type"]]), each["offset"])
        for each in message["fields"]
    ]
    for index, begin in enumerate(range(0, len(data) - stride + 1, stride)):
        yield {"index": index} | {
            name: kind.unpack_from(data, begin + offset)[0] for name, kind, offset in fields
        }
