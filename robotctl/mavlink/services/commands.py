"""COMMAND_LONG and COMMAND_INT: finds the handler of a command and acknowledges its result."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from pymavlink.dialects.v20 import common

from robotctl.mavlink.service import Context, source
from robotctl.messages.mavlink_port import Message, Peer

ACCEPTED: int = common.MAV_RESULT_ACCEPTED
TEMPORARILY_REJECTED: int = common.MAV_RESULT_TEMPORARILY_REJECTED
DENIED: int = common.MAV_RESULT_DENIED
UNSUPPORTED: int = common.MAV_RESULT_UNSUPPORTED

MAX_PENDING = 8
"""So many wait for an answer of each kind, no more than control answers at once: whoever invents
senders must not take the time in which a stop is waited for. The others are told to ask again."""


class Command(NamedTuple):
    """A command and where it came from.

    `params` are param1 to param7; of a COMMAND_INT, 5 and 6 are its integers x and y.
    `confirmation` counts how often the sender has sent it before; COMMAND_INT does not say.
    """

    number: int
    params: tuple[float, ...]
    sender: tuple[int, int]
    peer: Peer
    confirmation: int = 0


class CommandHandler(Protocol):
    """Carries out some commands."""

    @property
    def commands(self) -> frozenset[int]:
        """The MAV_CMD numbers it takes."""

    def on_command(self, command: Command, now_ns: int) -> int | None:
        """Return the MAV_RESULT, or None where `acknowledge` will follow."""


class Commands:
    """Takes commands; those without a handler are answered with UNSUPPORTED."""

    handles = frozenset({common.MAVLINK_MSG_ID_COMMAND_LONG, common.MAVLINK_MSG_ID_COMMAND_INT})

    def __init__(self, context: Context, handlers: Sequence[CommandHandler]) -> None:
        self._context = context
        self._handlers = {number: handler for handler in handlers for number in handler.commands}

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Carry out one command."""
        first = (message.param1, message.param2, message.param3, message.param4)
        if message.get_msgId() == common.MAVLINK_MSG_ID_COMMAND_INT:
            last = (float(message.x), float(message.y), message.z)
            confirmation = 0
        else:
            last = (message.param5, message.param6, message.param7)
            confirmation = message.confirmation
        command = Command(message.command, first + last, source(message), peer, confirmation)
        handler = self._handlers.get(command.number)
        result = UNSUPPORTED if handler is None else handler.on_command(command, now_ns)
        if result is not None:
            acknowledge(self._context, command, result)

    def step(self, now_ns: int) -> None:
        """Do nothing: handlers that answer later are services themselves."""


def acknowledge(context: Context, command: Command, result: int) -> None:
    """Send COMMAND_ACK to the sender of `command`."""
    system, component = command.sender
    context.links.reply(
        common.MAVLink_command_ack_message(
            command.number, result, 0, 0, target_system=system, target_component=component
        ),
        command.peer,
    )
