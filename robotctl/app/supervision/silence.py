"""Silence of a process: age of its last message, beyond a few of its periods."""

from __future__ import annotations

from typing import Final

STATE_HZ: Final = 50
"""Rate of control's published states [Hz]."""

STATE_PERIOD_NS: Final = 1_000_000_000 // STATE_HZ

PERIODS: Final = 3
"""Periods without a message after which a sender is silent."""


LONG_NS: Final = 500_000_000
"""Silence worth a line of its own [ns]; a shorter one may come from a stall of the reader."""


def silence(who: str, stamp_ns: int, now_ns: int, period_ns: int) -> str:
    """Return the duration of a sender's silence as text; empty if it is not silent.

    Parameters
    ----------
    who
        Name of the sender.
    stamp_ns, now_ns
        Time of its last message, and now [ns].
    period_ns
        Period of its messages [ns].
    """
    age_ns = now_ns - stamp_ns
    return f"{who} silent for {age_ns / 1e9:.1f} s" if age_ns > PERIODS * period_ns else ""
