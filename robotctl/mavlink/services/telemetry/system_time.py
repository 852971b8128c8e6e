"""SYSTEM_TIME: the time of day, and since when the robot's clock counts."""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import common

from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.frames import boot_ms
from robotctl.mavlink.service import Microservice
from robotctl.messages.mavlink_port import Message

RATE_HZ: Final = 1.0
"""Rate of the message [Hz]."""


class SystemTime(Microservice):
    """Sends the time once a second."""

    def streams(self) -> tuple[Stream, ...]:
        """Return the message."""
        group = common.MAV_DATA_STREAM_EXTRA3
        return (Stream(common.MAVLINK_MSG_ID_SYSTEM_TIME, self._build, RATE_HZ, group),)

    def _build(self, now_ns: int) -> list[Message]:
        wall_us = self._context.wall_ns() // 1000
        return [common.MAVLink_system_time_message(wall_us, boot_ms(now_ns))]
