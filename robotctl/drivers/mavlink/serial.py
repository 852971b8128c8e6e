"""MAVLink over a serial line or a telemetry radio (`serial`)."""

from __future__ import annotations

import termios
from collections.abc import Collection

import serial

from robotctl.drivers.mavlink.base import Link, LinkContext
from robotctl.drivers.mavlink.stream import Stream
from robotctl.messages.mavlink_port import LinkConfig, Message, Peer

QUEUE_S = 0.5
"""Maximum queue of telemetry, as time on the line [s]; older telemetry is useless."""


class SerialLink(Link):
    """One serial device, opened again when it was unplugged."""

    def __init__(self, number: int, config: LinkConfig, hub: LinkContext) -> None:
        super().__init__(number, config, hub)
        self._serial: serial.Serial | None = None
        self._stream: Stream | None = None

    def open_errors(self) -> tuple[type[Exception], ...]:
        """Return the exceptions of pyserial for absent, busy and unsuitable devices."""
        return (OSError, ValueError, termios.error)

    def is_open(self) -> bool:
        """Return whether the device is open."""
        return self._stream is not None

    def open(self, now_ns: int) -> None:  # noqa: ARG002
        """Open the device for this process alone."""
        path, baud = self.address.host, self.address.port
        self._serial = serial.Serial(path, baud, timeout=0, write_timeout=0, exclusive=True)
        limit = max(1024, int(baud / 10 * QUEUE_S))
        self._stream = Stream(self, self._serial.fileno(), limit, self.fail)
        self.opened()

    def watch(self, now_ns: int) -> None:
        """See to half frames and failed writes."""
        if self._stream is not None:
            self._stream.watch(now_ns)

    def broadcast(self, message: Message, peers: Collection[Peer] | None) -> None:
        """Queue for the line."""
        if self._stream is not None and (peers is None or self._stream.channel.peer in peers):
            self._stream.send(message, answer=False)

    def reply(self, message: Message, number: int) -> None:  # noqa: ARG002
        """Queue for the line, before telemetry where room ends."""
        if self._stream is not None:
            self._stream.send(message, answer=True)

    def forward(self, frame: bytes, number: int) -> None:  # noqa: ARG002
        """Queue a forwarded frame."""
        if self._stream is not None:
            self._stream.forward(frame)

    def flush(self) -> None:
        """Write as much as the line accepts."""
        if self._stream is not None:
            self._stream.flush()

    def peers(self) -> list[Peer]:
        """Return one peer while the device is open."""
        return [] if self._stream is None else [self._stream.channel.peer]

    def close(self) -> None:
        """Close the device."""
        if self._stream is not None:
            self._stream.close()
            self._stream = None
        if self._serial is not None:
            self._serial.close()
            self._serial = None
