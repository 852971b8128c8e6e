"""RADIO_STATUS: a radio that cannot keep up gets the streams more slowly.

A radio tells how much of its buffer is free. The robot stretches the intervals of all streams on
that link until there is room, and shortens them again by and by. Answers, heartbeats and texts are
sent as ever.
"""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import common

from robotctl.mavlink.context import Context
from robotctl.mavlink.service import Microservice
from robotctl.messages.mavlink_port import Message, Peer

SILENT_NS: Final = 10_000_000_000
"""Silence after which the radio counts as gone [ns]."""
MOST: Final = 20.0
"""Maximum factor by which intervals are stretched."""
_CHANGES: Final = ((20, 1.5), (50, 1.15), (90, 1.0), (95, 0.95), (100, 0.8))
"""Upper bounds of the free room [%], and the factor on intervals at each report."""


class Radios(Microservice):
    """Sets the stretch of each link."""

    handles = frozenset({common.MAVLINK_MSG_ID_RADIO_STATUS})

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._heard_ns: dict[int, int] = {}

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Take what a radio says of its buffer."""
        self._heard_ns[peer.link] = now_ns
        change = next((by for free, by in _CHANGES if message.txbuf <= free), 1.0)
        stretch = self._context.stretch
        stretch[peer.link] = min(max(stretch.get(peer.link, 1.0) * change, 1.0), MOST)

    def step(self, now_ns: int) -> None:
        """Forget radios that have fallen silent."""
        for link, heard_ns in list(self._heard_ns.items()):
            if now_ns - heard_ns > SILENT_NS:
                del self._heard_ns[link]
                self._context.stretch.pop(link, None)
