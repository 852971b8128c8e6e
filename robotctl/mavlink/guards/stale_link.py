"""Requests delayed by a link, detected by their sender's heartbeats.

A TCP connection over a radio that was away, or a serial bridge with a buffer, delivers what was
sent meanwhile all at once, and commands carry no time. But ground stations send a HEARTBEAT each
second: where a regular one has stayed away and comes again, what comes with it may be as old as
that. A robot that was stopped meanwhile must not be armed by it.

There is no verdict on a sender without regular heartbeats, or on a new connection, which has
delayed nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from robotctl.messages.mavlink_port import Peer

REGULAR_NS: Final = 1_500_000_000
"""Maximum interval of regular heartbeats, `REGULAR_COUNT` in a row [ns]."""
REGULAR_COUNT: Final = 3
"""Number of heartbeats that make a sender regular."""

AWAY_NS: Final = 2_500_000_000
"""Silence after which a regular sender was delayed; one lost heartbeat is not enough [ns]."""

BEHIND_NS: Final = 1_000_000_000
"""Time after the first sign of life during which delayed messages still arrive [ns]."""

MAX_SENDERS: Final = 64
"""Invented senders must not fill the memory."""


@dataclass(slots=True)
class _Sender:
    """Heartbeats of one sender, on one connection."""

    heard_ns: int
    regular: int = 0
    away_ns: int = 0
    back_ns: int = 0

    def hear(self, now_ns: int) -> None:
        """Take a sign of life."""
        silent_ns = now_ns - self.heard_ns
        if silent_ns > AWAY_NS and self.regular >= REGULAR_COUNT:
            self.away_ns, self.back_ns = silent_ns, now_ns
        self.regular = self.regular + 1 if silent_ns <= REGULAR_NS else 0
        self.heard_ns = now_ns


class HeldBack:
    """Tracks the heartbeats of all senders, ground stations and programs."""

    def __init__(self) -> None:
        self._senders: dict[tuple[Peer, tuple[int, int]], _Sender] = {}

    def hear(self, peer: Peer, address: tuple[int, int], now_ns: int) -> None:
        """Take one heartbeat of the system and component `address`."""
        key = peer, address
        sender = self._senders.get(key)
        if sender is None:
            if len(self._senders) >= MAX_SENDERS:
                # Full: drop the sender that has been silent longest.
                del self._senders[min(self._senders, key=lambda each: self._senders[each].heard_ns)]
            self._senders[key] = _Sender(now_ns)
        else:
            sender.hear(now_ns)

    def objection(self, peer: Peer, sender: tuple[int, int], now_ns: int) -> str:
        """Return why a sender's request may be an old one; empty: it is not.

        A sender that repeats its request a second later is accepted.
        """
        known = self._senders.get((peer, sender))
        if known is None:
            return ""
        if now_ns - known.heard_ns > AWAY_NS:
            known.hear(now_ns)
        if known.away_ns and now_ns - known.back_ns <= BEHIND_NS:
            away_s = known.away_ns / 1e9
            return f"the link was away for {away_s:.1f} s, this may be from before: ask again"
        return ""
