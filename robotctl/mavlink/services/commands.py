"""COMMAND_LONG and COMMAND_INT: dispatches a command and acknowledges its result."""

from __future__ import annotations

from typing import ClassVar

from pymavlink.dialects.v20 import common

from robotctl.mavlink.command import UNSUPPORTED, Command
from robotctl.mavlink.service import Microservice
from robotctl.messages.mavlink_port import Message, Peer, source


class Commands(Microservice):
    """Hands commands to their services; those of none are answered with UNSUPPORTED."""

    handles = frozenset({common.MAVLINK_MSG_ID_COMMAND_LONG, common.MAVLINK_MSG_ID_COMMAND_INT})
    capabilities: ClassVar[int] = common.MAV_PROTOCOL_CAPABILITY_COMMAND_INT

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Carry out one command."""
        first = (message.param1, message.param2, message.param3, message.param4)
        if message.get_msgId() == common.MAVLINK_MSG_ID_COMMAND_INT:
            last = (float(message.x), float(message.y), message.z)
            confirmation, frame = 0, message.frame
        else:
            last = (message.param5, message.param6, message.param7)
            confirmation, frame = message.confirmation, None
        command = Command(message.command, first + last, source(message), peer, confirmation, frame)
        handler = self._context.catalogue.commands.get(command.number)
        result = UNSUPPORTED if handler is None else handler(command, now_ns)
        if result is not None:
            self._context.acknowledge(command, result)
