"""Messages, commands and capabilities of all microservices together."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

from robotctl.mavlink.command import Command
from robotctl.messages.mavlink_port import Message

Builder: TypeAlias = Callable[[int], list[Message]]
"""Return the messages of now [ns], none if there is nothing to say."""

CommandHandler: TypeAlias = Callable[[Command, int], int | None]
"""Carry out a command now [ns]; return its MAV_RESULT, None if `acknowledge` follows."""

CancelHandler: TypeAlias = Callable[[Command, int], None]
"""Take back a command that waits for its acknowledgement, now [ns]."""


class Stream(NamedTuple):
    """One kind of message that the robot sends.

    Parameters
    ----------
    message_id
        Its MAVLink number; REQUEST_MESSAGE asks for it once.
    build
        Makes it.
    rate_hz
        How often it goes out to each peer until that asks for another rate [Hz]; 0 is
        off, None a message without a rate.
    group
        MAV_DATA_STREAM with which ArduPilot sends it, for the older REQUEST_DATA_STREAM; None: it
        is in no group.
    picked_by
        Field by which param2 of REQUEST_MESSAGE picks one of several, where 0 is all of them;
        empty: all of them come.
    """

    message_id: int
    build: Builder
    rate_hz: float | None
    group: int | None = None
    picked_by: str = ""


@dataclass(frozen=True, slots=True)
class Catalogue:
    """The sum of all microservices.

    Parameters
    ----------
    streams : mapping of int to Stream
        By number of the message, in the order in which they start.
    commands : mapping of int to callable
        Handler of each MAV_CMD.
    cancels : mapping of int to callable
        What takes each of them back.
    capabilities : int
        MAV_PROTOCOL_CAPABILITY bits.
    """

    streams: Mapping[int, Stream] = field(default_factory=dict)
    commands: Mapping[int, CommandHandler] = field(default_factory=dict)
    cancels: Mapping[int, CancelHandler] = field(default_factory=dict)
    capabilities: int = 0
