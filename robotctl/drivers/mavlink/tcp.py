"""MAVLink over TCP, as server (`tcpin`) and as client (`tcpout`)."""

from __future__ import annotations

import errno
import os
import selectors
import socket

from robotctl.drivers.mavlink.base import Link, LinkContext
from robotctl.drivers.mavlink.lookup import HostLookup
from robotctl.drivers.mavlink.stream import TCP_QUEUE, Stream, prepare_tcp
from robotctl.messages.mavlink_port import LinkConfig, Message

MAX_CLIENTS = 8
CONNECT_NS = 5_000_000_000
"""Time after which an unfinished connection attempt is repeated [ns]."""


class TcpServer(Link):
    """Listens, and serves up to 8 clients."""

    def __init__(self, number: int, config: LinkConfig, hub: LinkContext) -> None:
        super().__init__(number, config, hub)
        self._listener: socket.socket | None = None
        self._lookup: HostLookup | None = None
        self._clients: dict[Stream, socket.socket] = {}

    def is_open(self) -> bool:
        """Return whether the server listens."""
        return self._listener is not None

    def open(self, now_ns: int) -> None:  # noqa: ARG002
        """Look up the host, bind and listen."""
        self._lookup = self._lookup or HostLookup(*self.address[1:], socket.SOCK_STREAM)
        if (target := self._lookup.result()) is None:
            return
        self._lookup = None
        listener = socket.socket(target.family, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
        try:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind(target.sockaddr)
            listener.listen(MAX_CLIENTS)
        except OSError:
            listener.close()
            raise
        self._listener = listener
        self.hub.selector.register(listener, selectors.EVENT_READ, self._acceptable)
        self.opened()

    def _acceptable(self, _mask: int, now_ns: int) -> None:
        if self._listener is None:
            return
        try:
            connection, _ = self._listener.accept()
        except BlockingIOError:
            return
        except OSError as error:
            # Out of descriptors or memory: a listener left open would wake every poll at once.
            self.count_error(error)
            self._close_listener()
            self._back_off.failed(now_ns)
            return
        if len(self._clients) >= MAX_CLIENTS:
            connection.close()
            self.count_error(f"more than {MAX_CLIENTS} clients")
            return
        try:
            connection.setblocking(False)
            prepare_tcp(connection)
        except OSError as error:
            connection.close()
            self.count_error(error)
            return

        def lost(reason: Exception | str, now_ns: int) -> None:  # noqa: ARG001
            if isinstance(reason, OSError):
                self.count_error(reason)
            self._drop(stream)

        stream = Stream(self, connection.fileno(), TCP_QUEUE, lost)
        stream.channel.heard_ns = now_ns
        self._clients[stream] = connection

    def _drop(self, stream: Stream) -> None:
        connection = self._clients.pop(stream, None)
        if connection is not None:
            stream.close()
            connection.close()

    def watch(self, now_ns: int) -> None:
        """See to the streams of the clients."""
        for stream in list(self._clients):
            stream.watch(now_ns)

    def broadcast(self, message: Message) -> None:
        """Queue for all clients."""
        for stream in self._clients:
            stream.send(message, answer=False)

    def reply(self, message: Message, number: int) -> None:
        """Queue for one client."""
        for stream in self._clients:
            if stream.channel.peer.number == number:
                stream.send(message, answer=True)

    def flush(self) -> None:
        """Write to all clients."""
        for stream in self._clients:
            stream.flush()

    def peer_count(self) -> int:
        """Return the number of clients."""
        return len(self._clients)

    def bound_port(self) -> int:
        """Return the port on which the server listens, 0 if it does not."""
        return int(self._listener.getsockname()[1]) if self._listener is not None else 0

    def close(self) -> None:
        """Close the clients' connections and stop listening."""
        self._lookup = None
        for stream in list(self._clients):
            self._drop(stream)
        self._close_listener()

    def _close_listener(self) -> None:
        if self._listener is not None:
            self.hub.selector.unregister(self._listener)
            self._listener.close()
            self._listener = None


class TcpClient(Link):
    """Connects to one server, again and again."""

    def __init__(self, number: int, config: LinkConfig, hub: LinkContext) -> None:
        super().__init__(number, config, hub)
        self._socket: socket.socket | None = None
        self._lookup: HostLookup | None = None
        self._stream: Stream | None = None
        self._deadline_ns = 0

    def is_open(self) -> bool:
        """Return whether the connection is open or being opened."""
        return self._socket is not None

    def open(self, now_ns: int) -> None:
        """Look up the host and begin to connect."""
        self._lookup = self._lookup or HostLookup(*self.address[1:], socket.SOCK_STREAM)
        if (target := self._lookup.result()) is None:
            return
        self._lookup = None
        connection = socket.socket(target.family, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
        try:
            prepare_tcp(connection)
            status = connection.connect_ex(target.sockaddr)
            if status not in (0, errno.EINPROGRESS):
                raise OSError(status, os.strerror(status))
        except OSError:
            connection.close()
            raise
        self._socket = connection
        self._deadline_ns = now_ns + CONNECT_NS
        self.hub.selector.register(connection, selectors.EVENT_WRITE, self._connected)

    def _connected(self, _mask: int, now_ns: int) -> None:
        if self._socket is None:
            return
        status = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if status:
            self.fail(OSError(status, os.strerror(status)), now_ns)
            return
        self.hub.selector.unregister(self._socket)
        self._stream = Stream(self, self._socket.fileno(), TCP_QUEUE, self.fail)
        self.opened()

    def watch(self, now_ns: int) -> None:
        """Give up a connection that does not come about."""
        if self._stream is not None:
            self._stream.watch(now_ns)
        elif now_ns > self._deadline_ns:
            self.fail("no answer to the attempt to connect", now_ns)

    def broadcast(self, message: Message) -> None:
        """Queue for the server."""
        if self._stream is not None:
            self._stream.send(message, answer=False)

    def reply(self, message: Message, number: int) -> None:
        """Queue for the server, unless the connection is another one by now."""
        if self._stream is not None and self._stream.channel.peer.number == number:
            self._stream.send(message, answer=True)

    def flush(self) -> None:
        """Write to the server."""
        if self._stream is not None:
            self._stream.flush()

    def peer_count(self) -> int:
        """Return 1 while connected."""
        return int(self._stream is not None)

    def close(self) -> None:
        """Close the connection."""
        self._lookup = None
        if self._socket is not None:
            if self._stream is not None:
                self._stream.close()
                self._stream = None
            else:
                self.hub.selector.unregister(self._socket)
            self._socket.close()
            self._socket = None
