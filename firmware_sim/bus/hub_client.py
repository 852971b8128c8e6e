"""One client of a hub: a socket on one side, a port of the bus on the other."""

from __future__ import annotations

import select
import socket
from collections import deque
from collections.abc import Callable

from firmware_sim.bus import wire
from firmware_sim.bus.errors import ErrorState, overflow_message
from firmware_sim.bus.frame import Frame
from firmware_sim.bus.port import Port

_READS_PER_SERVICE = 64
SEND_FLAGS = socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL


class Client:
    """One connected process: a socket on one side, a port of the bus on the other.

    Parameters
    ----------
    connection
        The socket.
    since_ns
        CLOCK_MONOTONIC of its connection (ns).
    epoll
        Selector on which the socket is registered.
    greet
        Called with the client's name and options at its hello.
    backlog
        Maximum frames kept while it is slow.

    Attributes
    ----------
    port
        The client's node; None before its hello.
    lost
        Frames lost because it was too slow.
    malformed
        Messages that were not frames.
    dropped
        Frames it sent while bus-off or listening only.
    """

    def __init__(
        self,
        connection: socket.socket,
        since_ns: int,
        *,
        epoll: select.epoll,
        greet: Callable[[Client, str, wire.Options], None],
        backlog: int,
    ) -> None:
        self.port: Port | None = None
        self.lost = 0
        self.malformed = 0
        self.dropped = 0
        self.gone = False
        self.connection = connection
        self.since_ns = since_ns
        self.paused = False
        self._epoll = epoll
        self._greet = greet
        self._backlog_limit = backlog
        self._backlog: deque[bytes] = deque()
        self._overflown = False

    def receive(self, frame: Frame, origin_ns: int, own: int = 0) -> None:
        """Take a frame from the bus, whose time 0 is `origin_ns`; `own`: `wire.OWN` or 0."""
        if self.gone:
            return
        message = wire.stamp_frame(frame, frame.stamp_ns + origin_ns, own)
        if not self._backlog:
            try:
                self.connection.send(message, SEND_FLAGS)
            except BlockingIOError:
                pass
            except OSError:
                self.gone = True
                return
            else:
                return
        if len(self._backlog) >= self._backlog_limit:
            self.lost += 1
            self._overflown = True
            return
        self._backlog.append(message)
        self.watch()

    def watch(self) -> None:
        """Wait for the next possible event: send, unless paused; receive, if it is behind."""
        events = 0 if self.paused else select.EPOLLIN
        if self._backlog or self._overflown:
            events |= select.EPOLLOUT
        self._epoll.modify(self.connection.fileno(), events)

    def flush(self, now_ns: int) -> None:
        """Pass on waiting frames, and report lost ones; `now_ns` is CLOCK_MONOTONIC."""
        backlog = self._backlog
        try:
            while backlog:
                self.connection.send(backlog[0], SEND_FLAGS)
                backlog.popleft()
        except BlockingIOError:
            return
        except OSError:
            self.gone = True
            return
        if self._overflown:
            self._overflown = False
            self.receive(Frame(*overflow_message(), now_ns), 0)

    def read(self) -> None:
        """Take frames from the client while its queue on the bus has room."""
        for _ in range(_READS_PER_SERVICE):
            port = self.port
            if port is not None and not port.room and port.state is not ErrorState.BUS_OFF:
                self.paused = True
                return
            try:
                message = self.connection.recv(wire.MAX_MESSAGE, socket.MSG_DONTWAIT)
            except BlockingIOError:
                return
            except ConnectionResetError:  # it went with frames unread; what it sent comes next
                continue
            except OSError:
                message = b""
            if not message:
                self.gone = True
                return
            self._take(message)

    def _take(self, message: bytes) -> None:
        port = self.port
        is_frame = len(message) in wire.FRAME_SIZES or len(message) in wire.FD_FRAME_SIZES
        if port is not None and is_frame:
            try:
                arbitration_id, data = wire.unpack_frame(message)
                if not port.send(arbitration_id, data):
                    self.dropped += 1
            except ValueError:
                self.malformed += 1
            return
        filters = wire.unpack_filters(message)
        hello = wire.unpack_hello(message)
        if hello is not None:
            self._greet(self, *hello)
        elif filters is not None and port is not None:
            port.set_filters(filters)
        else:
            self.malformed += 1
