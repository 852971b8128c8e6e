"""Age of what a process last said: beyond a few of its periods it says nothing of the present."""

from __future__ import annotations

from typing import Final

STATE_HZ: Final = 50
"""States that control publishes in a second."""

STATE_PERIOD_NS: Final = 1_000_000_000 // STATE_HZ

PERIODS: Final = 3
"""Periods without a word after which a sender is silent."""


LONG_NS: Final = 500_000_000
"""Silence that is worth a line of its own [ns]: a shorter one may be the reader's own."""


def silence(who: str, stamp_ns: int, now_ns: int, period_ns: int) -> str:
    """Return for how long a sender has been silent, for people; empty if it is not.

    Parameters
    ----------
    who
        The sender.
    stamp_ns, now_ns
        Time of its last message, and now [ns].
    period_ns
        How often it sends [ns].
    """
    age_ns = now_ns - stamp_ns
    return f"{who} silent for {age_ns / 1e9:.1f} s" if age_ns > PERIODS * period_ns else ""
