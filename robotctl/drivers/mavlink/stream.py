"""One open byte stream of a link, a TCP connection or a serial line: reads, parses, queues."""

from __future__ import annotations

import os
import selectors
import socket
from collections.abc import Callable

from pymavlink.dialects.v20 import common

from robotctl.drivers.mavlink.base import READ_SIZE, Channel, Link
from robotctl.drivers.mavlink.queue import OutputQueue
from robotctl.messages.mavlink_port import Message

TCP_QUEUE = 32_768
TCP_SEND_BUFFER = 32_768
TCP_UNACKNOWLEDGED_MS = 10_000
"""Time without acknowledgement after which the kernel closes a connection [ms]."""


KEPT = frozenset({common.MAVLINK_MSG_ID_HEARTBEAT, common.MAVLINK_MSG_ID_STATUSTEXT})
"""Kept as answers are where room ends. Frames are never sent in another order than they were made:
the time stamps of signed ones must rise."""


class Stream:
    """A non-blocking file descriptor with its channel.

    Parameters
    ----------
    link : Link
        Whose counters and inbox it uses.
    descriptor : int
        Open, non-blocking; the owner closes it after `close`.
    queue_limit : int
        Bytes that may wait [B].
    lost : callable
        Called once with an error or a sentence, and the time [ns], when the stream has ended.
    """

    def __init__(
        self,
        link: Link,
        descriptor: int,
        queue_limit: int,
        lost: Callable[[Exception | str, int], None],
    ) -> None:
        self.channel: Channel = link.new_channel()
        self._link = link
        self._descriptor = descriptor
        self._queue = OutputQueue(queue_limit)
        self._lost = lost
        self._events = selectors.EVENT_READ
        self._write_error: OSError | None = None
        self._closed = False
        link.hub.selector.register(descriptor, self._events, self._ready)

    def _ready(self, mask: int, now_ns: int) -> None:
        # Closed by what another stream received in the same poll; the number may be another's now.
        if self._closed:
            return
        if mask & selectors.EVENT_READ:
            try:
                data = os.read(self._descriptor, READ_SIZE)
            except BlockingIOError:
                data = None
            except OSError as error:
                self._lost(error, now_ns)
                return
            if data == b"":
                self._lost("closed by the other side", now_ns)
                return
            if data:
                messages = self.channel.reader.feed(data, now_ns)
                self._link.deliver(messages, self.channel, now_ns)
        if mask & selectors.EVENT_WRITE:
            self.flush()

    def watch(self, now_ns: int) -> None:
        """See to half frames, and report a stream that could not be written."""
        if self._write_error is not None:
            self._lost(self._write_error, now_ns)
        else:
            messages = self.channel.reader.expire(now_ns)
            self._link.deliver(messages, self.channel, now_ns)

    def send(self, message: Message, *, answer: bool) -> None:
        """Queue one message."""
        frame = self.channel.encode(message)
        if frame is not None:
            self._push(frame, answer=answer or message.get_msgId() in KEPT)

    def forward(self, frame: bytes) -> None:
        """Queue a forwarded frame."""
        if self.channel.takes(frame):
            self._push(frame, answer=False)

    def _push(self, frame: bytes, *, answer: bool) -> None:
        """Queue one frame."""
        dropped = self._queue.dropped
        self._queue.push(frame, answer=answer)
        self._link.counters.sent += 1
        self._link.counters.dropped += self._queue.dropped - dropped

    def flush(self) -> None:
        """Write as much as the kernel accepts; the selector reports when it accepts more."""
        if self._queue and self._write_error is None:
            try:
                self._queue.write(self._write)
            except OSError as error:
                self._write_error = error
        wanted = selectors.EVENT_READ
        if self._queue and self._write_error is None:
            wanted |= selectors.EVENT_WRITE
        if wanted != self._events:
            self._events = wanted
            self._link.hub.selector.modify(self._descriptor, wanted, self._ready)

    def _write(self, chunk: bytes) -> int:
        return os.write(self._descriptor, chunk)

    def close(self) -> None:
        """Leave the selector."""
        self._closed = True
        self._link.hub.selector.unregister(self._descriptor)


def prepare_tcp(connection: socket.socket) -> None:
    """Set a TCP socket up for telemetry: small buffers, no delay, dead peers noticed."""
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, TCP_SEND_BUFFER)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, TCP_UNACKNOWLEDGED_MS)
