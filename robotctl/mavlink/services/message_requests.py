"""REQUEST_MESSAGE: any message that the robot sends, once."""

from __future__ import annotations

from pymavlink.dialects.v20 import common

from robotctl.mavlink.command import ACCEPTED, DENIED, TEMPORARILY_REJECTED, Command
from robotctl.mavlink.service import Microservice

REQUEST_MESSAGE: int = common.MAV_CMD_REQUEST_MESSAGE
REQUEST_CAPABILITIES: int = common.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES


class MessageRequests(Microservice):
    """Takes REQUEST_MESSAGE, and the older REQUEST_AUTOPILOT_CAPABILITIES for AUTOPILOT_VERSION."""

    commands = frozenset({REQUEST_MESSAGE, REQUEST_CAPABILITIES})

    def on_command(self, command: Command, now_ns: int) -> int:
        """Answer with the message; DENIED if it is not ours to send.

        TEMPORARILY_REJECTED where there is nothing to say in it at the moment.
        """
        message_id = command.whole(0)
        if command.number == REQUEST_CAPABILITIES:
            message_id = common.MAVLINK_MSG_ID_AUTOPILOT_VERSION
        stream = None if message_id is None else self._context.catalogue.streams.get(message_id)
        if stream is None:
            return DENIED
        messages = stream.build(now_ns)
        for message in messages:
            self._context.links.reply(message, command.peer)
        return ACCEPTED if messages else TEMPORARILY_REJECTED
