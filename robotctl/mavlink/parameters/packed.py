"""The parameters as a file: ArduPilot's packed format, `@PARAM/param.pck`.

A heading of magic, number of parameters in the file and in all (16 bits each), then for each
parameter its type (4 bits) and flags (4 bits: 1 says that a default follows), the letters it has in
common with the name before (4 bits) and the number of further ones less one (4 bits), these, and
the value. Source: ArduPilot, libraries/AP_Filesystem/AP_Filesystem_Param.cpp, README of the format.
"""

from __future__ import annotations

import struct
from itertools import takewhile
from typing import Final

from robotctl.config_values import Value
from robotctl.mavlink.parameters.parameter_set import ParameterSet

_MAGIC: Final = 0x671B
_MAGIC_DEFAULTS: Final = 0x671C
_INT32: Final = 3
_FLOAT: Final = 4
"""AP_Param's types."""
_HAS_DEFAULT: Final = 0x10
_MOST_COMMON: Final = 15
"""Flag of an entry that has its default, too; greatest number of letters shared with the name
before."""


def packed(parameters: ParameterSet, *, with_defaults: bool) -> bytes:
    """Return the file; with defaults those that a value differs from."""
    facts = parameters.facts()
    magic = _MAGIC_DEFAULTS if with_defaults else _MAGIC
    parts = [struct.pack("<HHH", magic, len(facts), len(facts))]
    before = ""
    for parameter, default, *_ in facts:
        name, value = parameter.name, parameters.value(parameter)
        # One letter at least is new: names differ, but one may begin with the other.
        same = len(
            list(takewhile(lambda pair: pair[0] == pair[1], zip(before, name, strict=False)))
        )
        common = min(same, _MOST_COMMON, len(name) - 1)
        rest, before = name[common:], name
        shows = with_defaults and value != default
        kind = (_FLOAT if isinstance(value, float) else _INT32) | (_HAS_DEFAULT if shows else 0)
        parts.append(struct.pack("<BB", kind, common | (len(rest) - 1) << 4) + rest.encode())
        parts.append(_number(value) + (_number(default) if shows else b""))
    return b"".join(parts)


def _number(value: Value) -> bytes:
    return struct.pack("<f" if isinstance(value, float) else "<i", value)
