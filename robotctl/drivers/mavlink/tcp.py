"""MAVLink over TCP, as server (`tcpin`) and as client (`tcpout`)."""

from __future__ import annotations

import errno
import os
import selectors
import socket
from collections.abc import Collection

from robotctl.drivers.mavlink.admission import MAX_PEERS, SILENT_NS, displaced
from robotctl.drivers.mavlink.base import Channel, Link, LinkContext
from robotctl.drivers.mavlink.lookup import HostLookup
from robotctl.drivers.mavlink.stream import TCP_QUEUE, Stream, prepare_tcp
from robotctl.messages.mavlink_port import LinkConfig, Message, Peer

MAX_CLIENTS = 2 * MAX_PEERS
"""Open connections, those served and those that wait for a place."""
CONNECT_NS = 5_000_000_000
"""Time after which an unfinished connection attempt is repeated [ns]."""


class TcpServer(Link):
    """Listens, and serves up to 8 clients; `admission` says which.

    As many more may be connected: they get nothing until they have a place, and all but their
    heartbeats is dropped. A client that sends no frame for 10 s is dropped.
    """

    def __init__(self, number: int, config: LinkConfig, hub: LinkContext) -> None:
        super().__init__(number, config, hub)
        self._listener: socket.socket | None = None
        self._lookup: HostLookup | None = None
        self._clients: dict[Stream, socket.socket] = {}
        self._served: dict[int, Stream] = {}
        """Clients by the number of the peer."""

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
        stream.channel.standing.heard_ns = now_ns
        self._clients[stream] = connection
        self._serve(stream.channel, now_ns)

    def _drop(self, stream: Stream) -> None:
        connection = self._clients.pop(stream, None)
        if connection is not None:
            self._served.pop(stream.channel.peer.number, None)
            stream.close()
            connection.close()

    def deliver(self, messages: list[Message], channel: Channel, now_ns: int) -> None:
        """Hand on what a client with a place has sent; the others may get one by it."""
        channel.standing.hear(messages, now_ns)
        has_place = channel.peer.number in self._served or self._serve(channel, now_ns)
        super().deliver(messages if has_place else [], channel, now_ns)

    def _serve(self, channel: Channel, now_ns: int) -> bool:
        """Give a waiting client a place, if there is one or it has precedence over another."""
        if len(self._served) >= MAX_PEERS:
            served = {each: each.channel.standing for each in self._served.values()}
            loser = displaced(channel.standing, served, now_ns)
            if loser is None:
                return False
            self._drop(loser)
        number = channel.peer.number
        waiting = (each for each in self._clients if each.channel.peer.number == number)
        self._served.update((number, stream) for stream in waiting)
        return True

    def watch(self, now_ns: int) -> None:
        """See to the streams of the clients, and drop the silent."""
        for stream in list(self._clients):
            stream.watch(now_ns)
            if stream.channel.standing.silent_ns(now_ns) > SILENT_NS:
                self._drop(stream)

    def broadcast(self, message: Message, peers: Collection[Peer] | None) -> None:
        """Queue for the clients with a place."""
        for stream in self._served.values():
            if peers is None or stream.channel.peer in peers:
                stream.send(message, answer=False)

    def reply(self, message: Message, number: int) -> None:
        """Queue for one client."""
        if (stream := self._served.get(number)) is not None:
            stream.send(message, answer=True)

    def forward(self, frame: bytes, number: int) -> None:
        """Queue a forwarded frame for one client."""
        if (stream := self._served.get(number)) is not None:
            stream.forward(frame)

    def flush(self) -> None:
        """Write to all clients."""
        for stream in self._served.values():
            stream.flush()

    def peers(self) -> list[Peer]:
        """Return the clients with a place."""
        return [stream.channel.peer for stream in self._served.values()]

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

    def broadcast(self, message: Message, peers: Collection[Peer] | None) -> None:
        """Queue for the server."""
        if self._stream is not None and (peers is None or self._stream.channel.peer in peers):
            self._stream.send(message, answer=False)

    def reply(self, message: Message, number: int) -> None:
        """Queue for the server, unless the connection is another one by now."""
        if self._stream is not None and self._stream.channel.peer.number == number:
            self._stream.send(message, answer=True)

    def forward(self, frame: bytes, number: int) -> None:
        """Queue a forwarded frame for the server."""
        if self._stream is not None and self._stream.channel.peer.number == number:
            self._stream.forward(frame)

    def flush(self) -> None:
        """Write to the server."""
        if self._stream is not None:
            self._stream.flush()

    def peers(self) -> list[Peer]:
        """Return one peer while connected."""
        return [] if self._stream is None else [self._stream.channel.peer]

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
