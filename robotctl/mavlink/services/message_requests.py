"""Commands that ask for messages, once or periodically, and AUTOPILOT_VERSION."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping

from pymavlink.dialects.v20 import common

from robotctl.mavlink.service import Context, TelemetryRobot
from robotctl.mavlink.services.commands import ACCEPTED, DENIED, TEMPORARILY_REJECTED, Command
from robotctl.mavlink.services.streams import OFF, Builder, Streams
from robotctl.messages.mavlink_port import Message

REQUEST_MESSAGE: int = common.MAV_CMD_REQUEST_MESSAGE
REQUEST_CAPABILITIES: int = common.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES
SET_INTERVAL: int = common.MAV_CMD_SET_MESSAGE_INTERVAL
GET_INTERVAL: int = common.MAV_CMD_GET_MESSAGE_INTERVAL
AUTOPILOT_VERSION: int = common.MAVLINK_MSG_ID_AUTOPILOT_VERSION
MAX_INTERVAL_US = 0x7FFF_FFFF
"""MESSAGE_INTERVAL carries a signed 32 bit number [us]: 36 minutes at most."""

CAPABILITIES: int = (
    common.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | common.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    | common.MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
    | common.MAV_PROTOCOL_CAPABILITY_MAVLINK2
)


class MessageRequests:
    """Takes REQUEST_MESSAGE, SET_ and GET_MESSAGE_INTERVAL, REQUEST_AUTOPILOT_CAPABILITIES.

    An interval holds on the link from which it was asked for.

    Parameters
    ----------
    context : Context
        Where answers go.
    streams : Streams
        The periodic messages.
    others : mapping of int to callable
        Further messages that may be asked for once.
    """

    commands = frozenset({REQUEST_MESSAGE, REQUEST_CAPABILITIES, SET_INTERVAL, GET_INTERVAL})

    def __init__(self, context: Context, streams: Streams, others: Mapping[int, Builder]) -> None:
        self._context = context
        self._streams = streams
        version = autopilot_version(context.robot)
        self._builders: dict[int, Builder] = {
            **streams.builders,
            **others,
            AUTOPILOT_VERSION: lambda _now_ns: [version],
        }

    def on_command(self, command: Command, now_ns: int) -> int:
        """Carry out one of the commands; DENIED where the message is not ours to send.

        TEMPORARILY_REJECTED where there is nothing to say in it at the moment.
        """
        if command.number == REQUEST_CAPABILITIES:
            return self._send(AUTOPILOT_VERSION, command, now_ns)
        message_id = _whole(command.params[0])
        if message_id is None:
            return DENIED
        if command.number == REQUEST_MESSAGE:
            return self._send(message_id, command, now_ns)
        if command.number == SET_INTERVAL:
            return self._set_interval(message_id, command, now_ns)
        return self._tell_interval(message_id, command)

    def _send(self, message_id: int, command: Command, now_ns: int) -> int:
        builder = self._builders.get(message_id)
        if builder is None:
            return DENIED
        messages = builder(now_ns)
        for message in messages:
            self._context.links.reply(message, command.peer)
        return ACCEPTED if messages else TEMPORARILY_REJECTED

    def _set_interval(self, message_id: int, command: Command, now_ns: int) -> int:
        interval_us = command.params[1]
        if not -1.0 <= interval_us <= MAX_INTERVAL_US:
            return DENIED
        interval_ns = OFF if interval_us < 0.0 else math.ceil(interval_us * 1000.0)
        link = command.peer.link
        return (
            ACCEPTED
            if self._streams.set_interval(message_id, link, interval_ns, now_ns)
            else DENIED
        )

    def _tell_interval(self, message_id: int, command: Command) -> int:
        interval_ns = self._streams.interval_ns(message_id, command.peer.link)
        interval_us = 0  # not a periodic message
        if interval_ns is not None:
            interval_us = -1 if interval_ns == OFF else interval_ns // 1000
        if not 0 <= message_id <= 0xFFFF:
            return DENIED
        message = common.MAVLink_message_interval_message(message_id, interval_us)
        self._context.links.reply(message, command.peer)
        return ACCEPTED


def autopilot_version(robot: TelemetryRobot) -> Message:
    """Return AUTOPILOT_VERSION; the unique identifier is a hash of the robot's name."""
    digest = hashlib.sha256(robot.name.encode()).digest()
    return common.MAVLink_autopilot_version_message(
        CAPABILITIES,
        version_number(robot.version),
        0,
        0,
        0,
        [0] * 8,
        [0] * 8,
        [0] * 8,
        0,
        0,
        int.from_bytes(digest[:8], "little"),
    )


def version_number(version: str) -> int:
    """Return `major.minor.patch` as MAVLink writes it, marked as an official release."""
    parts = [int(part) if part.isdigit() else 0 for part in [*version.split("."), "0", "0"][:3]]
    major, minor, patch = (min(part, 255) for part in parts)
    return major << 24 | minor << 16 | patch << 8 | int(common.FIRMWARE_VERSION_TYPE_OFFICIAL)


def _whole(value: float) -> int | None:
    """Return a parameter that must be a number of a message, None where it is not."""
    return int(value) if math.isfinite(value) and value == int(value) else None
