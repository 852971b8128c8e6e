"""Rate of each sender: one that sends often is missed sooner."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable
from typing import Final

FAST_NS: Final = 200_000_000
"""Mean interval of a sender that sends often, at 5 Hz or more [ns]."""
INTERVALS: Final = 5
"""Number of intervals that are averaged."""
MOST_SENDERS: Final = 64
"""Invented senders must not fill the memory; those beyond do not send often."""
_PAUSE_NS: Final = 1_000_000_000
"""Silence after which the rhythm of a sender is measured again [ns]."""
_SLACK: Final = 1.05
"""Tolerance on the interval, as a factor: timers of 0.2 s take a little longer."""


class Rhythm:
    """The last messages of each sender."""

    def __init__(self) -> None:
        self._sent_ns: dict[Hashable, deque[int]] = {}

    def is_fast(self, sender: Hashable, sent_ns: int) -> bool:
        """Note a message and when it was sent [ns]; return whether its sender sends often."""
        times = self._sent_ns.get(sender)
        if times is None or not 0 <= sent_ns - times[-1] <= _PAUSE_NS:
            self._forget(sent_ns)
            if len(self._sent_ns) < MOST_SENDERS or sender in self._sent_ns:
                self._sent_ns[sender] = deque([sent_ns], INTERVALS + 1)
            return False
        times.append(sent_ns)
        is_known = len(times) > INTERVALS
        return is_known and times[-1] - times[0] <= INTERVALS * FAST_NS * _SLACK

    def _forget(self, now_ns: int) -> None:
        """Drop the senders that have fallen silent."""
        self._sent_ns = {
            each: times for each, times in self._sent_ns.items() if now_ns - times[-1] <= _PAUSE_NS
        }
