"""Maximum ages of what the nodes report, and whether a time stamp is fresh."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from robotctl.messages.actuators import NEVER_NS
from robotctl.messages.faults import Fault, FaultCode

ANY_TIME_NS: Final = (NEVER_NS, -NEVER_NS)
"""First and last moment at which nothing at all is fresh [ns]."""

UNLIMITED_NS: Final = -2 * NEVER_NS
"""Age that nothing exceeds, what has never come included [ns]."""


class AgeLimit(NamedTuple):
    """Maximum age of a node's reports.

    Parameters
    ----------
    field
        Of `Feedback`; or "motion", "report" or "supply" of a drive's actuators.
    code
        Of the fault where it is older.
    words
        Beginning of the sentence for people, before "older than"; of sonars, before the limit.
    part
        Node or drive concerned; empty if it concerns no single one.
    limit_ns
        Maximum age [ns].
    """

    field: str
    code: FaultCode
    words: str
    part: str
    limit_ns: int

    def fault(self) -> Fault:
        """Return the fault of a value that is older."""
        text = f"{self.words} older than {self.limit_ns / 1e6:g} ms"
        return Fault(self.code, text, self.part)


def is_fresh(stamp_ns: int, now_ns: int, limit_ns: int) -> bool:
    """Return whether a stamp is within `limit_ns` of now, inclusive [ns].

    A stamp from the future by more than that would never grow old, so it is not fresh either.
    """
    return -limit_ns <= now_ns - stamp_ns <= limit_ns


def fresh_span_ns(stamps_ns: Sequence[int], limit_ns: int) -> tuple[int, int]:
    """Return the first and the last moment at which all stamps are fresh [ns]; of none, any is."""
    if not stamps_ns:
        return ANY_TIME_NS
    return max(stamps_ns) - limit_ns, min(stamps_ns) + limit_ns
