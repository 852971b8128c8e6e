"""Process data of a node as a proof of its state: one that has left operational sends none."""

from __future__ import annotations

from typing import NamedTuple

from robotctl.drivers.can.e2e import E2eReceiver


class Claim(NamedTuple):
    """NMT state to which a node in service is said to have come, and when that was said [ns]."""

    state: int
    stamp_ns: int


class ProcessData:
    """Receivers of a node's process data, and a claim that they may yet prove false.

    Attributes
    ----------
    claim
        Change of state that waits for a proof; None: there is none.
    receivers
        Receivers of its protected messages.
    """

    __slots__ = ("_late_ns", "claim", "receivers")

    def __init__(self) -> None:
        self.claim: Claim | None = None
        self.receivers: list[E2eReceiver] = []
        self._late_ns = 0
        """Time within which some of it comes [ns]."""

    def watch(self, receiver: E2eReceiver, late_ns: int) -> None:
        """Know a message that comes at least once in `late_ns` [ns]."""
        self.receivers.append(receiver)
        self._late_ns = min(late_ns, self._late_ns or late_ns)

    def restart(self) -> None:
        """Follow a node that has booted: its counters restart, which is no loss of frames."""
        for receiver in self.receivers:
            receiver.reset()

    def verdict(self, claim: Claim, now_ns: int) -> bool | None:
        """Return whether a claim is true; None: that is not known yet."""
        if any(receiver.continued_since(claim.stamp_ns) for receiver in self.receivers):
            return False
        return None if now_ns - claim.stamp_ns < self._late_ns else True
