"""REQUEST_MESSAGE: any message that the robot sends, once."""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import common

from robotctl.dialect import additions
from robotctl.mavlink.command import ACCEPTED, DENIED, TEMPORARILY_REJECTED, Command
from robotctl.mavlink.service import Microservice

REQUEST_MESSAGE: int = common.MAV_CMD_REQUEST_MESSAGE
_OLDER: Final[dict[int, int]] = {
    common.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: common.MAVLINK_MSG_ID_AUTOPILOT_VERSION,
    common.MAV_CMD_GET_HOME_POSITION: common.MAVLINK_MSG_ID_HOME_POSITION,
    common.MAV_CMD_REQUEST_PROTOCOL_VERSION: additions.MAVLINK_MSG_ID_PROTOCOL_VERSION,
}


class MessageRequests(Microservice):
    """Takes REQUEST_MESSAGE, and three older commands for one message each."""

    commands = frozenset({REQUEST_MESSAGE, *_OLDER})

    def on_command(self, command: Command, now_ns: int) -> int:
        """Answer with the message; DENIED if it is not ours to send.

        TEMPORARILY_REJECTED where there is nothing to say in it at the moment.
        """
        message_id = command.whole(0)
        message_id = _OLDER.get(command.number, message_id)
        stream = None if message_id is None else self._context.catalogue.streams.get(message_id)
        if stream is None:
            return DENIED
        messages = stream.build(now_ns)
        if stream.picked_by and (wanted := command.params[1]) > 0.0:
            messages = [each for each in messages if getattr(each, stream.picked_by) == wanted]
            if not messages:
                return DENIED
        for message in messages:
            self._context.links.reply(message, command.peer)
        return ACCEPTED if messages else TEMPORARILY_REJECTED
