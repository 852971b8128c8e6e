"""Limit on the texts that one sender causes: a flood of nonsense must not bury the others.

A bucket of words for each connection, so that invented addresses share one.
"""

from __future__ import annotations

from typing import Final

from robotctl.messages.mavlink_port import Peer

BURST: Final = 20
"""Maximum texts at once: as many as there may be objections to arming."""
EACH_NS: Final = 500_000_000
"""Time after which one more may be said [ns]."""


class WordLimit:
    """Counts the texts that each connection has caused."""

    def __init__(self) -> None:
        self._full_ns: dict[Peer, int] = {}
        """When each bucket is full again [ns]."""

    def allows(self, peer: Peer, now_ns: int) -> bool:
        """Return whether a text may be said for a connection now."""
        return self._full_ns.get(peer, now_ns) - now_ns <= (BURST - 1) * EACH_NS

    def take(self, peer: Peer, now_ns: int) -> None:
        """Count a text; forget the connections whose allowance is full again."""
        full_ns = max(self._full_ns.get(peer, now_ns), now_ns) + EACH_NS
        self._full_ns = {each: full for each, full in self._full_ns.items() if full > now_ns}
        self._full_ns[peer] = full_ns
