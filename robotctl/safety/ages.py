"""Maximum ages of what the nodes report, and whether a time stamp is fresh."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from robotctl.messages.actuators import NEVER_NS
from robotctl.messages.faults import Fault, FaultCode


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


def span_ns(stamps_ns: Sequence[int]) -> tuple[int, int]:
    """Return the oldest and the newest stamp [ns]; of none, what is fresh at any time."""
    return (min(stamps_ns), max(stamps_ns)) if stamps_ns else (-NEVER_NS, NEVER_NS)


def are_fresh(span: tuple[int, int], now_ns: int, limit_ns: int) -> bool:
    """Return whether all stamps of a `span_ns` are fresh: the oldest and the newest are [ns]."""
    oldest_ns, newest_ns = span
    return newest_ns - limit_ns <= now_ns <= oldest_ns + limit_ns
