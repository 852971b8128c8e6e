"""Common base of all MAVLink links: counters, one codec per peer, reopening with back-off."""

from __future__ import annotations

import errno
import selectors
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

from pymavlink.dialects.v10 import common as v1
from pymavlink.dialects.v20 import common

from robotctl.drivers.mavlink.admission import Standing
from robotctl.drivers.mavlink.frames import FrameReader
from robotctl.drivers.mavlink.listening import in_use
from robotctl.drivers.mavlink.signing import Signing
from robotctl.drivers.mavlink.tlog import TlogRecorder
from robotctl.messages.mavlink_port import LinkConfig, LinkStatus, Message, Peer, Received

READ_SIZE = 8192
"""Bytes read from one stream in one poll [B]: a flood must leave time for the other links."""

FIRST_RETRY_NS = 250_000_000
LAST_RETRY_NS = 5_000_000_000
"""Shortest and longest pause before a closed link is opened again [ns]."""

Callback: TypeAlias = Callable[[int, int], None]
"""Called with the selector's event mask and the time [ns]."""


class LinkContext(NamedTuple):
    """Shared resources of all links."""

    selector: selectors.EpollSelector
    inbox: list[Received]
    system_id: int
    component_id: int
    signing: Signing
    tlog: TlogRecorder | None = None


class Channel:
    """One peer of a link: its parser, its sequence numbers and its standing.

    Parameters
    ----------
    peer : Peer
        Its name towards the services.
    hub : LinkContext
        Gives the addresses written into each frame, and the key.
    safe : bool
        Whether a key may come over its link.
    """

    def __init__(self, peer: Peer, hub: LinkContext, *, safe: bool = False) -> None:
        self.peer = peer
        self._signing = hub.signing
        self._codec = common.MAVLink(None, hub.system_id, hub.component_id)
        self._codec.signing.link_id = peer.link & 0xFF
        self._codec_v1 = v1.MAVLink(None, hub.system_id, hub.component_id)
        decoder = common.MAVLink(None)
        self._tlog = hub.tlog
        self.reader = FrameReader(decoder, hub.signing, self._record, safe=safe)
        self.standing = Standing()
        self._seq = 0

    def encode(self, message: Message) -> bytes | None:
        """Return the next frame of this channel: MAVLink 2, unless the peer speaks 1 only.

        None if the message is not in MAVLink 1, whose numbers end at 255; it goes without the
        fields that only MAVLink 2 has.
        """
        codec = self._codec
        if self.reader.is_v1 and self._signing.key is None:
            kind = v1.mavlink_map.get(message.get_msgId())
            if kind is None:
                return None
            values = (getattr(message, name) for name in kind.fieldnames)
            message = kind(*(each.encode() if isinstance(each, str) else each for each in values))
            codec = self._codec_v1
        if self._signing.key is not None:
            codec.signing.secret_key = self._signing.key
            codec.signing.sign_outgoing = True
            # pymavlink has raised its own behind the last frame.
            newest = max(self.reader.newest + 1, codec.signing.timestamp)
            codec.signing.timestamp = max(self._signing.next_stamp(), newest)
        codec.seq = self._seq
        frame: bytes = message.pack(codec)
        self._seq = (self._seq + 1) & 0xFF
        self._record(frame)
        return frame

    def takes(self, frame: bytes) -> bool:
        """Say whether the peer understands a forwarded frame; record it then."""
        if self.reader.is_v1 and frame[0] == common.PROTOCOL_MARKER_V2:
            return False
        self._record(frame)
        return True

    def _record(self, frame: bytes | bytearray) -> None:
        if self._tlog is not None:
            self._tlog.record(self.peer.link, frame)


class BackOff:
    """When to try again: at once, then after doubling pauses."""

    def __init__(self) -> None:
        self._pause_ns = FIRST_RETRY_NS
        self._next_ns = 0

    def due(self, now_ns: int) -> bool:
        """Return whether the pause is over."""
        return now_ns >= self._next_ns

    def failed(self, now_ns: int) -> None:
        """Begin the next, longer pause."""
        self._next_ns = now_ns + self._pause_ns
        self._pause_ns = min(2 * self._pause_ns, LAST_RETRY_NS)

    def succeeded(self) -> None:
        """Begin with the shortest pause next time."""
        self._pause_ns = FIRST_RETRY_NS


@dataclass
class Counters:
    """The counters of `LinkStatus` that only grow, while the link is in use."""

    received: int = 0
    sent: int = 0
    bad_bytes: int = 0
    dropped: int = 0
    errors: int = 0
    opened: int = 0
    last_error: str = ""


class Link(ABC):
    """One link. None of its methods raises because of the outside world.

    Parameters
    ----------
    number : int
        Its place in the configuration.
    config : LinkConfig
        Its URL.
    hub : LinkContext
        Where to register sockets and put what came.
    """

    def __init__(self, number: int, config: LinkConfig, hub: LinkContext) -> None:
        self.number = number
        self.url = config.url
        self.address = config.address
        self.hub = hub
        self._safe = config.safe
        self.counters = Counters()
        self._back_off = BackOff()
        self._last_peer = -1

    def service(self, now_ns: int) -> None:
        """Reopen closed links after their pause, and handle time-outs."""
        if self.is_open():
            self.watch(now_ns)
        elif self._back_off.due(now_ns):
            try:
                self.open(now_ns)
            except self.open_errors() as error:
                self.fail(error, now_ns)

    def fail(self, error: Exception | str, now_ns: int) -> None:
        """Count an error, close, and try again after a pause."""
        self.count_error(error)
        self.close()
        self._back_off.failed(now_ns)

    def count_error(self, error: Exception | str) -> None:
        """Count an error."""
        self.counters.errors += 1
        self.counters.last_error = self._words(error)

    def _words(self, error: Exception | str) -> str:
        """Return the problem, and the remedy if known."""
        if isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
            return in_use(self.address.port)
        return getattr(error, "strerror", None) or str(error)

    def opened(self) -> None:
        """Count a successful opening."""
        self.counters.opened += 1
        self._back_off.succeeded()

    def new_channel(self) -> Channel:
        """Return a channel for a new peer."""
        self._last_peer += 1
        return self.channel(Peer(self.number, self._last_peer))

    def channel(self, peer: Peer) -> Channel:
        """Return a channel for a peer."""
        return Channel(peer, self.hub, safe=self._safe)

    def deliver(self, messages: list[Message], channel: Channel, now_ns: int) -> None:
        """Put messages of `channel` into the inbox and account for its bad bytes."""
        reader = channel.reader
        self.counters.bad_bytes += reader.bad_bytes
        self.counters.received += len(messages) + reader.unknown
        reader.bad_bytes = reader.unknown = 0
        channel.standing.hear(messages, now_ns)
        self.hub.inbox.extend(Received(message, channel.peer) for message in messages)

    def status(self) -> LinkStatus:
        """Return the link's counters."""
        counters = self.counters
        return LinkStatus(
            url=self.url,
            open=self.is_open(),
            peers=len(self.peers()),
            port=self.bound_port(),
            received=counters.received,
            sent=counters.sent,
            bad_bytes=counters.bad_bytes,
            dropped=counters.dropped,
            errors=counters.errors,
            opened=counters.opened,
            last_error=counters.last_error,
        )

    def open_errors(self) -> tuple[type[Exception], ...]:
        """Return the exceptions that `open` may raise."""
        return (OSError,)

    def bound_port(self) -> int:
        """Return the port of a server, else 0."""
        return 0

    @abstractmethod
    def is_open(self) -> bool:
        """Return whether `open` has succeeded or is still under way."""

    @abstractmethod
    def open(self, now_ns: int) -> None:
        """Open, or begin to; errors are counted by the caller."""

    @abstractmethod
    def watch(self, now_ns: int) -> None:
        """See to time-outs of an open link."""

    @abstractmethod
    def peers(self) -> list[Peer]:
        """Return the peers that would get a broadcast."""

    @abstractmethod
    def broadcast(self, message: Message, peers: Collection[Peer] | None) -> None:
        """Queue for all peers, or for those of `peers` that are there."""

    @abstractmethod
    def reply(self, message: Message, number: int) -> None:
        """Queue for the peer of this number, if it is there."""

    @abstractmethod
    def forward(self, frame: bytes, number: int) -> None:
        """Queue a forwarded frame for the peer of this number, if it is there."""

    @abstractmethod
    def flush(self) -> None:
        """Write the queue."""

    @abstractmethod
    def close(self) -> None:
        """Release everything; `open` may follow."""
