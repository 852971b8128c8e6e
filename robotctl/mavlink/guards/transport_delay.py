"""How late messages come, by `time_boot_ms` of their sender, whose clock is not ours.

After a drop-out, a TCP connection over a radio delivers its backlog at once: by the receiver's
clock all of it is new. The sender's clock helps, though its zero is unknown: the clock difference
is smallest for the fastest message, and any excess over that is transport delay. A delay that all
messages have in common is not seen.

The least difference rises by `LET_GO` of the time that passes, so that clocks may run apart and a
sender whose clock stood still for a moment is not refused for ever; a message held back for 2 s may
pass for one of 1.8 s.

There is no verdict on a sender whose `time_boot_ms`

- has not advanced as time does, within `LET_GO`, over `TRUST_NS`: it counts something else;
- stands still: it is not filled in, or too coarse;
- goes back: the sender was restarted, or messages overtook each other;
- was silent for `FORGET_NS`, or of any that appear while `MAX_STREAMS` others are active.

It then counts as a new sender without late messages. The wrap after 49.7 days is not going back.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Final

LET_GO: Final = 0.1
TRUST_NS: Final = 2_000_000_000
FORGET_NS: Final = 10_000_000_000
MAX_STREAMS: Final = 64
"""Invented senders must not fill the memory or take the time of all others."""

_WRAP_MS: Final = 1 << 32
"""Period after which `time_boot_ms` starts again [ms]."""


@dataclass(slots=True)
class _Stream:
    """Times [ns]; those of the sender count from its first message."""

    boot_ms: int
    first_ns: int
    heard_ns: int
    sent_ns: int = 0
    least_ns: float = 0.0
    trusted: bool = False

    def late_ns(self, boot_ms: int, now_ns: int) -> int | None:
        """Return how late a message is, None if it begins a new stream."""
        # Modulo 2^32 ms, because `time_boot_ms` wraps after 49.7 days.
        step_ms, elapsed_ns = (boot_ms - self.boot_ms) % _WRAP_MS, now_ns - self.heard_ns
        if not 0 < step_ms < _WRAP_MS // 2 or elapsed_ns > FORGET_NS:
            return None
        self.boot_ms, self.heard_ns = boot_ms, now_ns
        self.sent_ns += step_ms * 1_000_000
        passed_ns = now_ns - self.first_ns
        delay_ns = passed_ns - self.sent_ns
        # The minimum creeps upwards, so that clock drift does not make every message late.
        self.least_ns = min(float(delay_ns), self.least_ns + LET_GO * elapsed_ns)
        if not self.trusted and passed_ns >= TRUST_NS:
            # The sender's clock does not count milliseconds: do not use it.
            if abs(delay_ns) > LET_GO * passed_ns:
                return None
            self.trusted = True
        return round(delay_ns - self.least_ns) if self.trusted else 0


class SenderClocks:
    """One stream of messages for each key, such as a sender on a link."""

    def __init__(self) -> None:
        self._streams: dict[Hashable, _Stream] = {}

    def late_ns(self, key: Hashable, boot_ms: int, now_ns: int) -> int:
        """Return a message's delay relative to the fastest one [ns], 0 if unknown.

        Parameters
        ----------
        key
            Which stream it belongs to.
        boot_ms : int
            Its `time_boot_ms`, 0 to 2^32 - 1 [ms].
        now_ns : int
            When it was received, monotonic [ns].
        """
        stream = self._streams.get(key)
        late_ns = None if stream is None else stream.late_ns(boot_ms, now_ns)
        if late_ns is not None:
            return late_ns
        self._streams = {
            each: stream
            for each, stream in self._streams.items()
            if now_ns - stream.heard_ns <= FORGET_NS
        }
        if key in self._streams or len(self._streams) < MAX_STREAMS:
            self._streams[key] = _Stream(boot_ms, now_ns, now_ns)
        return 0
