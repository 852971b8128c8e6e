"""COMMAND_LONG and COMMAND_INT: dispatches a command and acknowledges its result.

One whose result takes long is acknowledged with IN_PROGRESS meanwhile, and may be given up by
COMMAND_CANCEL. https://mavlink.io/en/services/command.html.
"""

from __future__ import annotations

from typing import ClassVar, Final

from pymavlink.dialects.v20 import common

from robotctl.dialect import additions
from robotctl.mavlink.command import IN_PROGRESS, UNSUPPORTED, Command
from robotctl.mavlink.context import Pending
from robotctl.mavlink.service import Microservice
from robotctl.messages.mavlink_port import Message, Peer, source

LONG_NS: Final = 1_200_000_000
"""Time after which a pending result is announced, again and again [ns]: control refuses to arm
after 1 s, and who takes the first answer for the result shall get that."""
FORGOTTEN_NS: Final = 20_000_000_000
"""Time after which a pending result is forgotten [ns]: no service waits as long."""


class Commands(Microservice):
    """Hands commands to their services; those of none are answered with UNSUPPORTED."""

    handles = frozenset(
        {
            common.MAVLINK_MSG_ID_COMMAND_LONG,
            common.MAVLINK_MSG_ID_COMMAND_INT,
            additions.MAVLINK_MSG_ID_COMMAND_CANCEL,
        }
    )
    capabilities: ClassVar[int] = common.MAV_PROTOCOL_CAPABILITY_COMMAND_INT

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Carry out one command, or give one up."""
        if message.get_msgId() == additions.MAVLINK_MSG_ID_COMMAND_CANCEL:
            self._cancel(message, peer, now_ns)
            return
        first = (message.param1, message.param2, message.param3, message.param4)
        if message.get_msgId() == common.MAVLINK_MSG_ID_COMMAND_INT:
            last = (float(message.x), float(message.y), message.z)
            confirmation, frame = 0, message.frame
        else:
            last = (message.param5, message.param6, message.param7)
            confirmation, frame = message.confirmation, None
        command = Command(
            message.command,
            first + last,
            source(message),
            peer,
            confirmation,
            frame,
            message.get_seq(),
        )
        handler = self._context.catalogue.commands.get(command.number)
        result = UNSUPPORTED if handler is None else handler(command, now_ns)
        if result is not None:
            self._context.acknowledge(command, result)
        elif command.key not in self._context.pending:
            self._context.pending[command.key] = Pending(command, now_ns, now_ns)

    def _cancel(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Have a waiting command taken back, which its service acknowledges."""
        pending = self._context.pending.get((source(message), message.command, peer))
        if pending is not None:
            self._context.catalogue.cancels[message.command](pending.command, now_ns)

    def step(self, now_ns: int) -> None:
        """Tell senders whose command takes long that it is still under way."""
        for key, pending in list(self._context.pending.items()):
            if now_ns - pending.asked_ns > FORGOTTEN_NS:
                del self._context.pending[key]
            elif now_ns - pending.told_ns >= LONG_NS:
                pending.told_ns = now_ns
                self._context.tell_result(pending.command, IN_PROGRESS, pending.percent)
