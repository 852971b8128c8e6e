"""MAVLink over UDP, as client (`udpout`) and as server (`udpin`)."""

from __future__ import annotations

import errno
import selectors
import socket
from collections.abc import Collection
from typing import Any, Final, TypeAlias

from pymavlink.dialects.v20 import common

from robotctl.drivers.mavlink.admission import MAX_PEERS, SILENT_NS, displaced
from robotctl.drivers.mavlink.base import READ_SIZE, Channel, Link, LinkContext
from robotctl.drivers.mavlink.lookup import HostLookup
from robotctl.messages.mavlink_port import LinkConfig, Message, Peer

MAX_DATAGRAM = 2048
MOST_DATAGRAMS: Final = 1000
"""Datagrams read in one poll: 3 ms of work, where they are of one sender."""
BUFFER_SIZE: Final = 1 << 20
"""Wanted size of the kernel's buffer [B], of which a small datagram takes 0.8 kB."""
MAX_FORMER = 64
"""Number of forgotten peers that a server recognises again."""
TELL_NS: Final = 100_000_000
"""Least time between two answers to those who are not served [ns]: recorded frames of others might
ask for them, too."""

_NOBODY = (errno.ECONNREFUSED, errno.EHOSTDOWN)

_Sender: TypeAlias = Any  # what recvfrom returns and sendto takes; it depends on the family


class UdpLink(Link):
    """One datagram socket.

    A client sends to one ground station and takes datagrams from its address alone; where nobody
    has that port any more, the next who has it is another peer. A server learns its peers from
    valid frames and forgets them after 10 s of silence: they get nothing any more, but who comes
    again is the peer of before. It serves 8; `admission` says which.
    """

    def __init__(self, number: int, config: LinkConfig, hub: LinkContext) -> None:
        super().__init__(number, config, hub)
        self._server = self.address.kind == "udpin"
        self._socket: socket.socket | None = None
        self._lookup: HostLookup | None = None
        self._peers: dict[_Sender, Channel] = {}
        self._former: dict[_Sender, Peer] = {}
        """The forgotten, in that order."""
        self._broken = False
        self._told_ns = -TELL_NS
        """When a newcomer was told the time last [ns]."""

    def is_open(self) -> bool:
        """Return whether there is a socket."""
        return self._socket is not None

    def open(self, now_ns: int) -> None:  # noqa: ARG002
        """Look up the host, then bind or connect."""
        host, port = self.address.host, self.address.port
        self._lookup = self._lookup or HostLookup(host, port, socket.SOCK_DGRAM)
        if (target := self._lookup.result()) is None:
            return
        self._lookup = None
        opened = socket.socket(target.family, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        try:
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_SIZE)
            if self._server:
                opened.bind(target.sockaddr)
            else:
                opened.connect(target.sockaddr)
                self._peers = {opened.getpeername(): self.new_channel()}
        except OSError:
            opened.close()
            raise
        self._socket = opened
        self.hub.selector.register(opened, selectors.EVENT_READ, self._readable)
        self.opened()

    def watch(self, now_ns: int) -> None:
        """Forget silent peers; reopen after a failed send, for the network may be another one."""
        if self._broken:
            self.close()
            self._back_off.failed(now_ns)
            return
        for sender, channel in list(self._peers.items()):
            self.deliver(channel.reader.expire(now_ns), channel, now_ns)
            if self._server and channel.standing.silent_ns(now_ns) > SILENT_NS:
                self._forget(sender)

    def _forget(self, sender: _Sender) -> None:
        """Send to a peer no more, but know it again."""
        self._former[sender] = self._peers.pop(sender).peer
        if len(self._former) > MAX_FORMER:
            del self._former[next(iter(self._former))]

    def _channel(self, sender: _Sender) -> Channel:
        """Return a channel for a peer that is not served now, a former one under its name."""
        former = self._former.get(sender)
        return self.new_channel() if former is None else self.channel(former)

    def _readable(self, _mask: int, now_ns: int) -> None:
        """Read all that waits; of each sender, and of all who are not served, only so much counts.

        So a flood of one neither takes the time of the others nor leaves their datagrams no room in
        the socket.
        """
        taken: dict[_Sender, int] = {}
        for _ in range(MOST_DATAGRAMS):
            if self._socket is None:
                return
            try:
                data, sender = self._socket.recvfrom(MAX_DATAGRAM)
            except BlockingIOError:
                return
            except OSError as error:
                if error.errno not in _NOBODY:
                    self.fail(error, now_ns)
                else:
                    self._nobody(error)
                return
            key = sender if sender in self._peers else None
            taken[key] = taken.get(key, 0) + len(data) + 1
            if taken[key] - len(data) <= READ_SIZE:
                self._receive(data, sender, now_ns)
            else:
                self.counters.bad_bytes += len(data)

    def _receive(self, data: bytes, sender: _Sender, now_ns: int) -> None:
        channel = self._peers.get(sender) or self._channel(sender)
        messages = channel.reader.feed_datagram(data, now_ns)
        if sender not in self._peers:
            channel.standing.hear(messages, now_ns)
            if not messages or not self._has_room(channel, now_ns):
                self.counters.bad_bytes += len(data)
                self._tell_time(channel, sender, now_ns)
                return
            self._peers[sender] = channel
            self._former.pop(sender, None)
        self.deliver(messages, channel, now_ns)

    def _tell_time(self, newcomer: Channel, sender: _Sender, now_ns: int) -> None:
        """Let a newcomer who has the key, but is late, learn the time by a signed message."""
        if self._server and newcomer.reader.late and now_ns - self._told_ns >= TELL_NS:
            self._told_ns = now_ns
            boot_ms = now_ns // 1_000_000 & 0xFFFF_FFFF
            time = common.MAVLink_system_time_message(self.hub.signing.wall_us, boot_ms)
            self._send(newcomer.encode(time), sender)

    def _has_room(self, newcomer: Channel, now_ns: int) -> bool:
        """Say whether a peer can be served, after making room for it where it has precedence."""
        if len(self._peers) < MAX_PEERS:
            return True
        served = {sender: channel.standing for sender, channel in self._peers.items()}
        loser = displaced(newcomer.standing, served, now_ns)
        if loser is not None:
            self._forget(loser)
        return loser is not None

    def _nobody(self, error: OSError) -> None:
        """Note that a peer's port is closed, which is no fault of the link."""
        if not self._server:
            self.counters.last_error = self._words(error)
        for sender, channel in self._peers.items():
            if not self._server and channel.standing.heard_ns is not None:
                self._peers[sender] = self.new_channel()

    def broadcast(self, message: Message, peers: Collection[Peer] | None) -> None:
        """Send to peers at once; a datagram that finds no room is dropped."""
        for sender, channel in self._peers.items():
            if peers is None or channel.peer in peers:
                self._send(channel.encode(message), sender)

    def reply(self, message: Message, number: int) -> None:
        """Send to the peer of this number."""
        for sender, channel in self._peers.items():
            if channel.peer.number == number:
                self._send(channel.encode(message), sender)

    def forward(self, frame: bytes, number: int) -> None:
        """Send a forwarded frame."""
        for sender, channel in self._peers.items():
            if channel.peer.number == number and channel.takes(frame):
                self._send(frame, sender)

    def _send(self, frame: bytes | None, target: _Sender) -> None:
        if frame is None or self._socket is None or self._broken:
            return
        try:
            if self._server:
                self._socket.sendto(frame, target)
            else:
                self._socket.send(frame)
        except BlockingIOError:
            self.counters.dropped += 1
        except OSError as error:
            self.counters.dropped += 1
            if error.errno in _NOBODY:
                self._nobody(error)
            else:
                self.count_error(error)
                self._broken = not self._server
        else:
            self.counters.sent += 1

    def flush(self) -> None:
        """Do nothing: no datagram waits."""

    def peers(self) -> list[Peer]:
        """Return the known peers."""
        return [channel.peer for channel in self._peers.values()]

    def bound_port(self) -> int:
        """Return the port of a server, else 0."""
        if self._socket is None or not self._server:
            return 0
        return int(self._socket.getsockname()[1])

    def close(self) -> None:
        """Close the socket; a server opened again learns its peers from their messages."""
        self._lookup = None
        self._broken = False
        for sender in list(self._peers):
            self._forget(sender)
        if self._socket is not None:
            self.hub.selector.unregister(self._socket)
            self._socket.close()
            self._socket = None
