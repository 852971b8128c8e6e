"""Personality: the autopilot that the robot claims to be, and what stations conclude from it.

Stations know by the MAV_AUTOPILOT of the HEARTBEAT how modes are numbered, how integers are packed
into PARAM_VALUE, whether item 0 of a mission is home, and what stands in fields without a value.
Sources: ArduPilot, Rover/mode.h; PX4, src/modules/commander/px4_custom_mode.h;
https://mavlink.io/en/services/parameter.html#parameter-encoding.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import common

from robotctl.config_values import Value
from robotctl.dialect import additions
from robotctl.messages.mode import Mode

_MAIN: Final = 16
_SUB: Final = 24
"""Bits of PX4's main and sub mode in `custom_mode`."""


def _px4(main: int, sub: int = 0) -> int:
    return main << _MAIN | sub << _SUB


@dataclass(frozen=True, slots=True)
class Personality:
    """One autopilot that the robot can claim to be.

    Parameters
    ----------
    autopilot
        MAV_AUTOPILOT.
    modes
        `custom_mode` of each mode.
    has_home_item
        Whether item 0 of a mission is home.
    is_bytewise
        Whether an integer parameter is sent as its four bytes, else as the number.
    has_sub_modes
        Whether DO_SET_MODE gives PX4's main and sub mode in two parameters.
    unused
        What stands in a float field that the robot has no value for.
    unknown
        Messages that the dialect of its stations does not have: they count them as lost, so they
        are sent to who asks for them alone.
    """

    autopilot: int
    modes: Mapping[Mode, int]
    has_home_item: bool
    is_bytewise: bool
    has_sub_modes: bool
    unused: float
    unknown: frozenset[int] = frozenset()

    @property
    def capabilities(self) -> int:
        """MAV_PROTOCOL_CAPABILITY bits."""
        if self.is_bytewise:
            return int(common.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE)
        return int(common.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST)

    def mode_of(self, custom_mode: float) -> Mode | None:
        """Return the mode of a `custom_mode`; None: there is none."""
        return next((mode for mode, number in self.modes.items() if number == custom_mode), None)

    def custom_mode(self, second: float, third: float) -> float:
        """Return the `custom_mode` of param2 and param3 of DO_SET_MODE."""
        if not self.has_sub_modes or not 0.0 <= second <= 255.0:
            return second
        sub = third if 0.0 <= third <= 255.0 else 0.0
        return float(_px4(int(second), int(sub)))

    def param_value(self, value: Value) -> float:
        """Return the number of PARAM_VALUE for a parameter's value."""
        return number_of(value) if self.is_bytewise else float(value)

    def value_of(self, number: float, kind: int) -> float:
        """Return the value that a number of PARAM_SET, of a MAV_PARAM_TYPE, means."""
        return whole_of(number, kind) if self.is_bytewise else number


def number_of(value: Value) -> float:
    """Return a float with the bytes of an integer; others as they are."""
    if isinstance(value, float):
        return value
    return float(struct.unpack("<f", struct.pack("<i", value))[0])


def whole_of(number: float, kind: int) -> float:
    """Return the integer whose bytes a float has, if it is of that type; others as they are."""
    if kind != common.MAV_PARAM_TYPE_INT32:
        return number
    return float(struct.unpack("<i", struct.pack("<f", number))[0])


_BY_NUMBER: Final = {mode: mode.value for mode in Mode}

PERSONALITIES: Final[Mapping[str, Personality]] = {
    "ardupilot": Personality(
        common.MAV_AUTOPILOT_ARDUPILOTMEGA,
        _BY_NUMBER,
        has_home_item=True,
        is_bytewise=False,
        has_sub_modes=False,
        unused=0.0,
        unknown=frozenset(additions.MESSAGES) - {additions.MAVLINK_MSG_ID_EKF_STATUS_REPORT},
    ),
    "px4": Personality(
        common.MAV_AUTOPILOT_PX4,
        {
            Mode.MANUAL: _px4(1),
            Mode.HOLD: _px4(4, 3),
            Mode.AUTO: _px4(4, 4),
            Mode.RTL: _px4(4, 5),
            Mode.GUIDED: _px4(6),
        },
        has_home_item=False,
        is_bytewise=True,
        has_sub_modes=True,
        unused=math.nan,
    ),
    "generic": Personality(
        common.MAV_AUTOPILOT_GENERIC,
        _BY_NUMBER,
        has_home_item=False,
        is_bytewise=True,
        has_sub_modes=False,
        unused=math.nan,
    ),
}
"""Personalities by the name of `[mavlink] personality`. PX4's modes are MANUAL, AUTO with the sub
modes LOITER, MISSION and RTL, and OFFBOARD."""
