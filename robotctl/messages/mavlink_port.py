"""Port of the MAVLink links over sockets and serial lines, and their URLs."""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, TypeAlias

from robotctl.errors import InvalidValue

KINDS = ("udpout", "udpin", "tcpout", "tcpin", "serial")
FORMS = (
    "udpout:HOST:PORT, udpin:HOST:PORT, tcpout:HOST:PORT, tcpin:HOST:PORT or serial:/dev/NAME:BAUD"
)
HOSTS = (
    "an IPv4 address, an IPv6 address in brackets, or a name of parts of 1 to 63 characters with "
    "single dots between them"
)
MAX_BAUD = 4_000_000

Message: TypeAlias = Any
"""A pymavlink message object; pymavlink has no types, and is not imported by the configuration."""

_SOCKET = re.compile(r"(?:\[([^\[\]]+)\]|([^:\[\]\s]+)):(\d{1,5})")
_SERIAL = re.compile(r"(/\S+):(\d{1,7})")


class LinkAddress(NamedTuple):
    """A link's URL in parts. `port` is the UDP or TCP port, or the baud rate of a serial line."""

    kind: str
    host: str
    port: int


@dataclass(frozen=True, slots=True)
class LinkConfig:
    """One MAVLink link.

    Parameters
    ----------
    url : str
        `udpout:HOST:PORT` sends to a ground station, `udpin:HOST:PORT` waits for several,
        `tcpout:HOST:PORT` connects to a server, `tcpin:HOST:PORT` is one,
        `serial:/dev/NAME:BAUD` is a serial line or radio. IPv6 hosts stand in brackets.
    safe : bool
        Whether a signing key may come over it: nobody else can listen, as on a cable.
    blocked_messages, blocked_systems, blocked_components : tuple of int
        Messages of others that are not forwarded to it, by message number and by sender.

    Raises
    ------
    ValueError
        If `url` has another form, its host is impossible, or a number is invalid; the message names
        what is allowed.
    """

    url: str
    safe: bool = False
    blocked_messages: tuple[int, ...] = ()
    blocked_systems: tuple[int, ...] = ()
    blocked_components: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        for name, most in (
            ("blocked_messages", 0xFF_FFFF),
            ("blocked_systems", 0xFF),
            ("blocked_components", 0xFF),
        ):
            for number in getattr(self, name):
                if not 0 <= number <= most:
                    raise InvalidValue(name, f"must be 0 to {most}, not {number}", number)
        try:
            parse_link_url(self.url)
        except ValueError as error:
            raise InvalidValue("url", str(error), self.url) from None

    @property
    def address(self) -> LinkAddress:
        """The URL in parts."""
        return parse_link_url(self.url)


def parse_link_url(url: str) -> LinkAddress:
    """Split the URL of a link.

    Raises
    ------
    ValueError
        Names the problem of `url` and the allowed forms.
    """
    kind, _, rest = url.partition(":")
    if kind not in KINDS:
        near = difflib.get_close_matches(kind, KINDS, n=1)
        hint = f'; did you mean "{near[0]}"?' if near else ""
        raise _refusal(url, f'"{kind}" is no kind of link{hint}')
    if kind == "serial":
        if not (serial := _SERIAL.fullmatch(rest)):
            raise _refusal(url, "a serial line needs a device path and a baud rate")
        baud = int(serial[2])
        if not 0 < baud <= MAX_BAUD:
            raise _refusal(url, f"baud rate {baud} is not in 1 to {MAX_BAUD}")
        return LinkAddress(kind, serial[1], baud)
    if not (socket := _SOCKET.fullmatch(rest)):
        raise _refusal(url, "this link needs a host and a port")
    port = int(socket[3])
    lowest = 0 if kind.endswith("in") else 1
    if not lowest <= port <= 65535:
        raise _refusal(url, f"port {port} is not in {lowest} to 65535")
    host = socket[1] or socket[2]
    if not _may_be_host(host):
        raise _refusal(url, f'"{host}" is no host', HOSTS)
    return LinkAddress(kind, host, port)


def _may_be_host(host: str) -> bool:
    """Return whether `host` can be a host name."""
    try:
        host.encode("idna")  # as `socket.getaddrinfo` does
    except UnicodeError:
        return False
    return True


def _refusal(url: str, problem: str, allowed: str = FORMS) -> ValueError:
    return ValueError(f'"{url}": {problem}; allowed: {allowed}')


class Peer(NamedTuple):
    """One remote end: index of the link in the configuration, and a number unique to each peer."""

    link: int
    number: int


Address: TypeAlias = tuple[int, int]
"""System id and component id."""


def source(message: Message) -> Address:
    """Return the system and component that sent `message`."""
    return message.get_srcSystem(), message.get_srcComponent()


class Received(NamedTuple):
    """A message with a complete frame and a valid checksum (a pymavlink object)."""

    message: Message
    peer: Peer


@dataclass(frozen=True, slots=True)
class LinkStatus:
    """Statistics of one link since the start.

    `bad_bytes` belonged to no valid frame; `dropped` frames had no room or no listener; `opened`
    counts (re)connections; `port` is the bound port of a server, else 0.
    """

    url: str
    open: bool
    peers: int
    port: int
    received: int
    sent: int
    bad_bytes: int
    dropped: int
    errors: int
    opened: int
    last_error: str


class MavlinkPort(Protocol):
    """Several MAVLink links that never raise and never wait unless asked to."""

    @property
    def count(self) -> int:
        """Number of links."""

    def poll(self, now_ns: int, timeout_s: float = 0.0) -> list[Received]:
        """Service the links and return received messages, after waiting at most `timeout_s`."""

    def peers(self) -> tuple[Peer, ...]:
        """Return the present peers: a server's accepted clients, and stations on serial lines."""

    def broadcast(self, message: Message, peers: Collection[Peer] | None = None) -> None:
        """Queue `message` for all of `peers` (None: all); dropped first if the queue is full."""

    def reply(self, message: Message, peer: Peer) -> None:
        """Queue `message` for one peer; ignored if the peer has left."""

    def forward(self, message: Message, peers: Collection[Peer]) -> None:
        """Queue the frame of a received message for others, unchanged."""

    def flush(self) -> None:
        """Pass the queue to the operating system, as far as it accepts it."""

    def status(self) -> tuple[LinkStatus, ...]:
        """Return the counters of each link, in the order of the configuration."""

    def close(self) -> None:
        """Release all links."""
