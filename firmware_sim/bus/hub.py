"""Couples a simulated bus to other processes in real time, over a Unix socket.

Each client is a node of the bus, as if it had a CAN adapter of its own: its frames pass
arbitration, it acknowledges, it has error counters. There is no thread: the owner of the bus waits
for `Hub.fileno()` to become readable, or for `Bus.next_event_ns`, advances the bus and calls
`Hub.service`. Frames go out to the clients from within `Bus.advance`, at their completion.

Only processes of the same user, and root, may connect (checked with SO_PEERCRED).

Flow control: while a client's transmit queue on the bus is full nothing more is read from it, so
that its own socket fills up and `send` fails there, as it does with ENOBUFS on SocketCAN. Frames of
a bus-off client are read and dropped, so nothing stale is sent after recovery. To a slow client up
to `backlog` frames are kept; after that frames are lost, counted, and the client gets an error
message (CAN_ERR_CRTL, RX_OVERFLOW) as from a controller that has overflown.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import logging
import os
import select
import socket
import struct
from pathlib import Path
from typing import TYPE_CHECKING

from firmware_sim.bus import wire
from firmware_sim.bus.channels import private_directory, socket_paths
from firmware_sim.bus.hub_client import SEND_FLAGS, Client
from firmware_sim.bus.state import FdSupport

if TYPE_CHECKING:
    from firmware_sim.bus.core import Bus

_LOG = logging.getLogger(__name__)
_GREETING_NS = 2_000_000_000
_LAST_FRAMES = 1 << 16
_CREDENTIALS = struct.Struct("3i")


class HubError(Exception):
    """A hub cannot be opened; the message says which, where and why."""


class Hub:
    """The socket of one channel and all its clients.

    Parameters
    ----------
    bus
        The bus the clients become nodes of.
    channel
        Name of the channel, or a path (see `channels.py`).
    origin_ns
        CLOCK_MONOTONIC at time 0 of the bus (ns): frames to clients are stamped with the sum.
    restart_ms
        Pause of bus-off clients before they recover (see `Bus.attach`).
    queue_limit
        Maximum frames of one client in its transmit queue.
    backlog
        Frames kept for a slow client, besides about 250 in its socket.

    Raises
    ------
    HubError
        If a hub is running on the channel, or the socket cannot be made.
    ValueError
        If the channel's name is invalid.
    """

    def __init__(
        self,
        bus: Bus,
        channel: str = "simcan0",
        *,
        origin_ns: int = 0,
        restart_ms: int | None = 100,
        queue_limit: int = 64,
        backlog: int = 1024,
    ) -> None:
        self.bus = bus
        self.channel = channel
        self.origin_ns = origin_ns
        self._backlog = backlog
        self.path = socket_paths(channel)[0]
        self._restart_ms = restart_ms
        self._queue_limit = queue_limit
        self._clients: dict[int, Client] = {}
        self._lock = self._take_lock()
        self._listener = self._listen()
        self._epoll = select.epoll()
        self._epoll.register(self._listener.fileno(), select.EPOLLIN)

    def _take_lock(self) -> int:
        """Lock the channel for this process; the kernel releases it when the process ends."""
        path = Path(f"{self.path}.lock")
        try:
            if "/" not in self.channel:
                private_directory(self.path.parent)
            lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
        except OSError as error:
            raise HubError(f"channel {self.channel!r}: cannot open {path}: {error}") from error
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            owner = os.read(lock, 20).decode(errors="replace").strip()
            os.close(lock)
            raise HubError(
                f"channel {self.channel!r}: a hub is already running on it "
                f"(process {owner or 'unknown'}, {self.path}); give this one a name of its own, "
                "as in --bus simcan:NAME"
            ) from None
        if not path.exists() or path.stat().st_ino != os.fstat(lock).st_ino:
            os.close(lock)  # a hub that was closing has just removed it
            return self._take_lock()
        os.ftruncate(lock, 0)
        os.write(lock, f"{os.getpid()}\n".encode())
        return lock

    def _give_back_lock(self) -> None:
        Path(f"{self.path}.lock").unlink(missing_ok=True)
        os.close(self._lock)

    def _listen(self) -> socket.socket:
        """Bind under another name and rename, so that an existing path always has a listener.

        Replaces what a killed hub left; no other process holds the lock.
        """
        fresh = Path(f"{self.path}.new")
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        mask = os.umask(0o177)
        try:
            fresh.unlink(missing_ok=True)
            listener.bind(os.fspath(fresh))
            listener.listen(16)
            if self.path.exists() and not self.path.is_socket():
                raise FileExistsError(errno.EEXIST, "it is there and no socket")
            fresh.rename(self.path)
        except OSError as error:
            listener.close()
            fresh.unlink(missing_ok=True)
            self._give_back_lock()
            raise HubError(f"channel {self.channel!r}: cannot bind {self.path}: {error}") from error
        finally:
            os.umask(mask)
        listener.setblocking(False)
        return listener

    def fileno(self) -> int:
        """Return the descriptor that is readable when `service` has something to do."""
        return self._epoll.fileno()

    @property
    def clients(self) -> tuple[Client, ...]:
        """All connected clients."""
        return tuple(self._clients.values())

    def service(self, now_ns: int) -> None:
        """Take new clients and their frames, at the bus's present time; never waits.

        To be called when `fileno` is readable, and now and then besides (every 100 ms or less).

        Parameters
        ----------
        now_ns
            CLOCK_MONOTONIC (ns), for the time-out of clients that do not say hello.
        """
        for descriptor, events in self._epoll.poll(0):
            client = self._clients.get(descriptor)
            if client is None:
                self._accept(now_ns)
            else:
                self._handle(client, events)
        for client in self.clients:
            if client.port is None and now_ns - client.since_ns > _GREETING_NS:
                client.gone = True
            if client.paused and client.port is not None and client.port.room:
                client.paused = False
                client.watch()
            if client.gone:
                self._remove(client)

    def _handle(self, client: Client, events: int) -> None:
        """Read from or write to a client, as its socket is ready."""
        if events & select.EPOLLOUT:
            client.flush(self.bus.now_ns + self.origin_ns)
        if events & select.EPOLLHUP and client.port is not None:
            client.port.queue_limit = _LAST_FRAMES  # it will not send more than lies there
        if events & ~select.EPOLLOUT:
            client.read()
        if not client.gone:
            client.watch()

    def _accept(self, now_ns: int) -> None:
        with contextlib.suppress(BlockingIOError, ConnectionAbortedError):
            connection, _ = self._listener.accept()
            credentials = connection.getsockopt(
                socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size
            )
            process, user, _ = _CREDENTIALS.unpack(credentials)
            if user not in (os.geteuid(), 0):
                _LOG.warning("%s: refused process %d of user %d", self.channel, process, user)
                connection.close()
                return
            connection.setblocking(False)
            self._clients[connection.fileno()] = Client(
                connection, now_ns, epoll=self._epoll, greet=self._greet, backlog=self._backlog
            )
            self._epoll.register(connection.fileno(), select.EPOLLIN)

    def _greet(self, client: Client, name: str, options: wire.Options) -> None:
        """Make a client a node of the bus, or change the options of one that is."""
        listen_only = bool(options & wire.Options.LISTEN_ONLY)
        if client.port is not None:
            client.port.set_listen_only(listen_only)
            return
        own = bool(options & wire.Options.RECEIVE_OWN)
        client.port = self.bus.attach(
            self._free_name(name or "client"),
            lambda frame: client.receive(frame, self.origin_ns),
            errors=bool(options & wire.Options.ERRORS),
            on_sent=(lambda frame: client.receive(frame, self.origin_ns, wire.OWN))
            if own
            else None,
            queue_limit=self._queue_limit,
            restart_ms=self._restart_ms,
            listen_only=listen_only,
            fd=_fd_support(options),
        )
        given = client.port.name.encode()[:16]
        rates = self.bus.bitrate, self.bus.data_bitrate
        welcome = wire.WELCOME.pack(wire.WELCOME_MAGIC, wire.Answer.OK, 0, *rates, given)
        try:
            client.connection.send(welcome, SEND_FLAGS)
        except OSError:
            client.gone = True

    def _free_name(self, name: str) -> str:
        taken = {port.name for port in self.bus.ports}
        number = 1
        free = name
        while free in taken:
            number += 1
            free = f"{name}#{number}"
        return free

    def _remove(self, client: Client) -> None:
        """Forget a client; frames it has sent still go out on the bus."""
        del self._clients[client.connection.fileno()]
        self._epoll.unregister(client.connection.fileno())
        client.connection.close()
        if client.port is not None:
            client.port.close()

    def close(self) -> None:
        """Disconnect all clients and remove the channel."""
        for client in self.clients:
            client.gone = True
            if client.port is not None:
                client.port.detach()
                client.port = None
            self._remove(client)
        self._epoll.close()
        self._listener.close()
        self.path.unlink(missing_ok=True)
        self._give_back_lock()


def _fd_support(options: wire.Options) -> FdSupport:
    """Return what a client's controller does with frames of CAN FD."""
    if options & wire.Options.FD:
        return FdSupport.ENABLED
    return FdSupport.TOLERANT if options & wire.Options.FD_TOLERANT else FdSupport.INTOLERANT
