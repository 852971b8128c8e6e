"""Unit and description of a value of the robot's file, from the docstring of its table."""

from __future__ import annotations

import inspect
import re
from functools import cache
from typing import Any, Final

from robotctl.config_values import descriptions

_UNITS: Final = {
    "_m_s": "m/s", "_m_s2": "m/s^2", "_m_s3": "m/s^3", "_m": "m", "_rad_s": "rad/s",
    "_rad_s2": "rad/s^2", "_rad_s3": "rad/s^3", "_rad": "rad", "_deg": "deg", "_s": "s",
    "_ms": "ms", "_hz": "Hz", "_v": "V", "_ohm": "ohm", "_per_s": "1/s", "_v_s_rad": "V s/rad",
    "_share": "",
}  # fmt: skip
"""Unit by the end of the key, the longest that fits."""
_UNIT: Final = re.compile(r"\[([A-Za-z][^\],]*)\]")


def words(config: Any, key: str) -> tuple[str, str]:
    """Return the unit, empty without one, and the description of the value at a dotted key."""
    *tables, name = key.split(".")
    for part in tables:
        config = getattr(config, part)
    table: type = type(config)
    text = _descriptions_of(table).get(name, "")
    suffixes = [suffix for suffix in _UNITS if name.endswith(suffix)]
    if suffixes:
        return _UNITS[max(suffixes, key=len)], text
    found = _UNIT.search(text)
    return (found[1] if found else ""), text


@cache
def _descriptions_of(table: type) -> dict[str, str]:
    return descriptions(inspect.getdoc(table) or "")
