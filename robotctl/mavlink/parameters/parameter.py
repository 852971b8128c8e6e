"""One parameter: a value of the robot's file under a name of MAVLink."""

from __future__ import annotations

import enum
import math
import struct
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import common

from robotctl.config_values import Value

MOST_LETTERS: Final = 16
REAL32: Final[int] = common.MAV_PARAM_TYPE_REAL32
INT32: Final[int] = common.MAV_PARAM_TYPE_INT32
_FIGURES: Final = range(6, 10)
"""Significant digits of a 32 bit number; 9 distinguish all of them."""


class Change(enum.Enum):
    """When a new value takes effect.

    A running robot is never made less careful than its start left it: what protects it changes at
    once to the safe side only, seen from the value of the start, and for the rest after a restart.
    """

    ANY = "at once"
    LOWER = "at once up to the value of the start, above it after a restart"
    HIGHER = "at once down to the value of the start, below it after a restart"
    RESTART = "after a restart"
    NEVER = "in the robot's file only"

    def nearest(self, value: Value, began_with: Value) -> Value:
        """Return the value nearest to a new one that may take effect at once."""
        match self:
            case Change.ANY:
                return value
            case Change.LOWER:
                return min(value, began_with)
            case Change.HIGHER:
                return max(value, began_with)
            case Change.RESTART | Change.NEVER:
                return began_with


class Parameter(NamedTuple):
    """A line of the table.

    Parameters
    ----------
    name
        Of MAVLink: 16 capital letters, digits and underscores at most.
    key
        Dotted, of a number of the robot's file; robots without it have no such parameter.
    low, high
        Range that ground stations are told and may set.
    change
        When a new value takes effect.
    """

    name: str
    key: str
    low: float
    high: float
    change: Change = Change.RESTART


def kind_of(value: Value) -> int:
    """Return the MAV_PARAM_TYPE of a value."""
    return REAL32 if isinstance(value, float) else INT32


def single(value: Value) -> float:
    """Return a value as the 32 bit number that MAVLink carries; infinite where that has no room."""
    try:
        return float(struct.unpack("<f", struct.pack("<f", float(value)))[0])
    except OverflowError:
        return math.copysign(math.inf, value)


def shortest(value: float) -> float:
    """Return the decimal number that people meant by a 32 bit number: 0.1, not 0.10000000149."""
    if not math.isfinite(value):
        return value
    texts = (f"{value:.{figures}g}" for figures in _FIGURES)
    return next((float(text) for text in texts if single(float(text)) == value), value)
