"""Passes messages on between the links, by the rules of MAVLink.

https://mavlink.io/en/guide/routing.html: what is for everybody goes to all other peers, what is for
a system or component to those peers from which it was heard, and nothing back to where it came
from. Frames are passed on as they are, with their signature.
"""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import common

from robotctl.mavlink.config import MavlinkConfig
from robotctl.messages.mavlink_port import MavlinkPort, Message, Peer, Received, source

MOST_ROUTES: Final = 128
"""Components that are remembered, the longest silent go first."""
MOST_IN_A_STEP: Final = 100
"""Maximum messages passed on in a step, so that a flood leaves time for the robot's own."""
REPEATED_NS: Final = 500_000_000
"""Time within which a frame that comes again has gone in a circle [ns]."""
_MOST_FRAMES: Final = 512
_OURS_ALONE: Final = frozenset(
    {
        common.MAVLINK_MSG_ID_RADIO_STATUS,
        common.MAVLINK_MSG_ID_SETUP_SIGNING,
        common.MAVLINK_MSG_ID_TIMESYNC,
    }
)
"""Messages that are not passed on: a radio speaks of its own link, a key is for its receiver alone,
and two answers to a question for the time would mislead."""


class Forwarder:
    """Learns who is behind which peer, and passes on what is for others.

    Parameters
    ----------
    links
        Take what is passed on.
    config
        Address of the robot, and what its links do not take.
    """

    def __init__(self, links: MavlinkPort, config: MavlinkConfig) -> None:
        self._links = links
        self._self = (config.system_id, config.component_id)
        self._filters = dict(enumerate(config.link))
        self._routes: dict[tuple[int, int], Peer] = {}
        self._frames: dict[bytes, int] = {}
        """When each frame came last, the oldest first [ns]."""
        self._left = MOST_IN_A_STEP

    def begin(self) -> None:
        """Begin a step."""
        self._left = MOST_IN_A_STEP

    def take(self, received: Received, now_ns: int) -> None:
        """Learn a route, and pass one message on."""
        message, peer = received
        sender = source(message)
        if sender == self._self or not self._is_new(bytes(message.get_msgbuf()), now_ns):
            return
        self._routes.pop(sender, None)
        self._routes[sender] = peer
        if len(self._routes) > MOST_ROUTES:
            del self._routes[next(iter(self._routes))]
        if message.get_msgId() in _OURS_ALONE:
            return
        system = getattr(message, "target_system", 0)
        behind = self._behind(system, getattr(message, "target_component", 0)) - {peer}
        targets = {each for each in behind if self._passes(message, each.link)}
        if targets and self._left:
            self._left -= 1
            self._links.forward(message, targets)

    def _passes(self, message: Message, link: int) -> bool:
        """Say whether a link takes a message of others."""
        config = self._filters.get(link)
        if config is None:
            return True
        system, component = source(message)
        return not (
            message.get_msgId() in config.blocked_messages
            or system in config.blocked_systems
            or component in config.blocked_components
        )

    def _behind(self, system: int, component: int) -> set[Peer]:
        """Return the peers that lead to a target; 0 is all of them."""
        present = self._links.peers()
        if system == 0:
            return set(present)
        if (system, component) == self._self:
            return set()
        known = {
            peer
            for (system_id, component_id), peer in self._routes.items()
            if system_id == system and component in (0, component_id)
        }
        return known.intersection(present)

    def _is_new(self, frame: bytes, now_ns: int) -> bool:
        """Return whether a frame has not just come by another route."""
        last_ns = self._frames.pop(frame, None)
        self._frames[frame] = now_ns
        if len(self._frames) > _MOST_FRAMES:
            del self._frames[next(iter(self._frames))]
        return last_ns is None or now_ns - last_ns > REPEATED_NS
