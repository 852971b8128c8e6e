"""All MAVLink links of the robot on one selector."""

from __future__ import annotations

import selectors
from collections.abc import Collection, Sequence
from typing import Self

from robotctl.drivers.mavlink.base import Link, LinkContext
from robotctl.drivers.mavlink.serial import SerialLink
from robotctl.drivers.mavlink.signing import Signing
from robotctl.drivers.mavlink.tcp import TcpClient, TcpServer
from robotctl.drivers.mavlink.tlog import TlogRecorder
from robotctl.drivers.mavlink.udp import UdpLink
from robotctl.messages.mavlink_port import LinkConfig, LinkStatus, Message, Peer, Received

_LINKS: dict[str, type[Link]] = {
    "udpout": UdpLink,
    "udpin": UdpLink,
    "tcpout": TcpClient,
    "tcpin": TcpServer,
    "serial": SerialLink,
}


class MavlinkLinks:
    """Implements `MavlinkPort` with sockets and serial lines.

    Links open in the first `poll` and reopen by themselves, with pauses from 0.25 to 5 s. Nothing
    here raises because of the outside world: errors are counted in `status`.

    Parameters
    ----------
    configs : sequence of LinkConfig
        The links, in the order in which `Peer.link` counts them.
    system_id, component_id : int
        Address written into every frame, 1 to 255.
    signing : Signing
        Whose frames are taken; None: everybody's.
    tlog : TlogRecorder
        Records what is sent and taken; the caller closes it. None: nothing.
    """

    def __init__(
        self,
        configs: Sequence[LinkConfig],
        system_id: int = 1,
        component_id: int = 1,
        signing: Signing | None = None,
        tlog: TlogRecorder | None = None,
    ) -> None:
        self._selector = selectors.EpollSelector()
        self._inbox: list[Received] = []
        hub = LinkContext(
            self._selector, self._inbox, system_id, component_id, signing or Signing(), tlog
        )
        self._links = [
            _LINKS[config.address.kind](number, config, hub)
            for number, config in enumerate(configs)
        ]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def count(self) -> int:
        """Number of links."""
        return len(self._links)

    def fileno(self) -> int:
        """Return a descriptor that is readable when `poll` has something to do, for zmq.Poller."""
        return self._selector.fileno()

    def poll(self, now_ns: int, timeout_s: float = 0.0) -> list[Received]:
        """Keep the links alive and return received messages.

        Parameters
        ----------
        now_ns : int
            Monotonic time [ns].
        timeout_s : float
            Longest wait for something to come [s]; 0 does not wait.
        """
        for link in self._links:
            link.service(now_ns)
        wait_s = 0.0 if self._inbox else timeout_s
        for key, mask in self._selector.select(wait_s):
            key.data(mask, now_ns)
        received = list(self._inbox)
        self._inbox.clear()
        return received

    def peers(self) -> tuple[Peer, ...]:
        """Return who is served now."""
        return tuple(peer for link in self._links for peer in link.peers())

    def broadcast(self, message: Message, peers: Collection[Peer] | None = None) -> None:
        """Queue `message` for all of `peers` that are there (None: everybody)."""
        for link in self._links:
            link.broadcast(message, peers)

    def reply(self, message: Message, peer: Peer) -> None:
        """Queue `message` for one peer; ignored if the peer is gone."""
        self._links[peer.link].reply(message, peer.number)

    def forward(self, message: Message, peers: Collection[Peer]) -> None:
        """Queue the frame of a received message for others, as it came."""
        frame = bytes(message.get_msgbuf())
        for peer in peers:
            self._links[peer.link].forward(frame, peer.number)

    def flush(self) -> None:
        """Pass the queue to the operating system, as far as it accepts it."""
        for link in self._links:
            link.flush()

    def status(self) -> tuple[LinkStatus, ...]:
        """Return the counters of each link, in the order of the configuration."""
        return tuple(link.status() for link in self._links)

    def close(self) -> None:
        """Release all links."""
        for link in self._links:
            link.flush()
            link.close()
        self._selector.close()
