"""MAVLink microservices, and the routing of messages to them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from robotctl.mavlink.catalogue import CancelHandler, Catalogue, CommandHandler, Stream
from robotctl.mavlink.command import Command
from robotctl.mavlink.config import MavlinkConfig
from robotctl.mavlink.context import Context
from robotctl.messages.mavlink_port import Message, Peer, Received, source


class Microservice:
    """One MAVLink microservice: reacts to messages and commands, acts with time.

    It says by these attributes what it takes and brings, and writes the methods that it needs.
    """

    handles: ClassVar[frozenset[int]] = frozenset()
    """Numbers of the messages that `on_message` takes."""

    commands: ClassVar[frozenset[int]] = frozenset()
    """MAV_CMD numbers that `on_command` carries out."""

    capabilities: ClassVar[int] = 0
    """MAV_PROTOCOL_CAPABILITY bits that the robot has by it."""

    def __init__(self, context: Context) -> None:
        self._context = context

    def streams(self) -> tuple[Stream, ...]:
        """Return the messages that it makes, with their rates; asked for once."""
        return ()

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Take one message that is addressed to this robot."""

    def on_command(self, command: Command, now_ns: int) -> int | None:
        """Carry out one command; return its MAV_RESULT, None if `acknowledge` follows."""
        raise NotImplementedError

    def on_cancel(self, command: Command, now_ns: int) -> None:
        """Take back a command whose result is awaited, and acknowledge it with CANCELLED.

        Of a service that lets commands wait.
        """

    def step(self, now_ns: int) -> None:
        """Do what time or the robot's state requires."""


def catalogue_of(services: Sequence[Microservice]) -> Catalogue:
    """Return the sum of all services.

    Raises
    ------
    ValueError
        If two of them answer the same command or make the same message.
    """
    streams: dict[int, Stream] = {}
    commands: dict[int, CommandHandler] = {}
    cancels: dict[int, CancelHandler] = {}
    owners: dict[tuple[str, int], str] = {}
    capabilities = 0
    for service in services:
        name = type(service).__name__
        capabilities |= service.capabilities
        for number in sorted(service.commands):
            _claim(owners, ("MAV_CMD", number), name)
            commands[number] = service.on_command
            cancels[number] = service.on_cancel
        for stream in service.streams():
            _claim(owners, ("message", stream.message_id), name)
            streams[stream.message_id] = stream
    return Catalogue(streams, commands, cancels, capabilities)


def _claim(owners: dict[tuple[str, int], str], what: tuple[str, int], name: str) -> None:
    """Note that `name` has a command or a message for itself."""
    if what in owners:
        kind, number = what
        raise ValueError(f"{kind} {number} belongs to {owners[what]}; {name} claims it, too")
    owners[what] = name


class Router:
    """Gives each message to the services that handle it.

    Dropped and counted are messages for others (`misaddressed`) and our own that came back
    (`echoes`); unhandled messages are skipped.
    """

    def __init__(self, services: Sequence[Microservice], config: MavlinkConfig) -> None:
        idle = Microservice.step
        self._stepped = tuple(each for each in services if type(each).step is not idle)
        self._handlers: dict[int, list[Microservice]] = {}
        for service in services:
            for message_id in service.handles:
                self._handlers.setdefault(message_id, []).append(service)
        self._system = (0, config.system_id)
        self._component = (0, config.component_id)
        self._self = (config.system_id, config.component_id)
        self.misaddressed = 0
        self.echoes = 0

    def route(self, received: Received, now_ns: int) -> None:
        """Hand one message to its services."""
        message = received.message
        handlers = self._handlers.get(message.get_msgId())
        if handlers is None:
            return
        if source(message) == self._self:
            self.echoes += 1
        elif (
            getattr(message, "target_system", 0) not in self._system
            or getattr(message, "target_component", 0) not in self._component
        ):
            self.misaddressed += 1
        else:
            for service in handlers:
                service.on_message(message, received.peer, now_ns)

    def step(self, now_ns: int) -> None:
        """Step all services that have something to do in their order."""
        for service in self._stepped:
            service.step(now_ns)
