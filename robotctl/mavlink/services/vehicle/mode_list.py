"""AVAILABLE_MODES and CURRENT_MODE: the modes by name, for stations that know no ArduRover.

https://mavlink.io/en/services/standard_modes.html
"""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import common

from robotctl.dialect import additions
from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.context import Context
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import Mode
from robotctl.messages.mavlink_port import Message

STANDARD: Final[dict[Mode, int]] = {
    Mode.AUTO: common.MAV_STANDARD_MODE_MISSION,
    Mode.RTL: common.MAV_STANDARD_MODE_SAFE_RECOVERY,
}
"""Modes that MAV_STANDARD_MODE has for vehicles on the ground."""
_NONE: Final[int] = common.MAV_STANDARD_MODE_NON_STANDARD
RATE_HZ: Final = 0.5
"""Rate of CURRENT_MODE [Hz]."""


class ModeList(Microservice):
    """Lists the modes on request, and says which one the robot is in, at once when it changes."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._told: Mode | None = None

    def streams(self) -> tuple[Stream, ...]:
        """Return both messages."""
        modes, mode = (
            additions.MAVLINK_MSG_ID_AVAILABLE_MODES,
            additions.MAVLINK_MSG_ID_CURRENT_MODE,
        )
        return (
            Stream(modes, self._modes, None, picked_by="mode_index"),
            Stream(mode, self._mode, RATE_HZ),
        )

    def step(self, now_ns: int) -> None:
        """Send CURRENT_MODE when it has changed."""
        navigation = self._context.fresh_navigation(now_ns)
        if navigation is not None and navigation.mode is not self._told:
            self._told = navigation.mode
            receivers = self._context.receivers(additions.MAVLINK_MSG_ID_CURRENT_MODE)
            for message in self._mode(now_ns):
                self._context.links.broadcast(message, receivers)

    def _modes(self, now_ns: int) -> list[Message]:  # noqa: ARG002
        """Return one AVAILABLE_MODES for each mode, numbered from 1."""
        numbers = self._context.personality.modes
        return [
            additions.MAVLink_available_modes_message(
                len(Mode), index, _standard(mode), numbers[mode], 0, mode.name.encode()
            )
            for index, mode in enumerate(Mode, 1)
        ]

    def _mode(self, now_ns: int) -> list[Message]:
        navigation = self._context.fresh_navigation(now_ns)
        if navigation is None:
            return []
        mode = navigation.mode
        number = self._context.personality.modes[mode]
        return [additions.MAVLink_current_mode_message(_standard(mode), number, number)]


def _standard(mode: Mode) -> int:
    return STANDARD.get(mode, _NONE)
