"""Requests to arm: which wait, which come at a wrong time, and the last answers."""

from __future__ import annotations

from typing import Final

from robotctl.messages.control import Ack, Arm
from robotctl.messages.faults import Fault, FaultCode
from robotctl.safety.state_machine import SafetyConfig

_KEPT: Final = 8
"""Maximum of waiting requests and of answers: more than arrive within one publishing period."""

_CLEAR_INTERVAL_NS: Final = 100_000_000
"""Pause between two attempts to clear the drives' latches [ns]."""


class ArmRequests:
    """Requests to arm without an answer, and the latest answers.

    Parameters
    ----------
    safety
        Maximum age of a request, and the time for which it may wait.

    Attributes
    ----------
    waiting
        `request_id`s that wait, in order of arrival.
    since_ns
        When the first of them arrived [ns]: later ones do not postpone the answer.
    objections
        Reasons of the host computer that came with the last of them.
    acks
        The last answers to any `Arm`, the newest last.
    stopped_ns
        Time of the last emergency stop or fault [ns].
    """

    def __init__(self, safety: SafetyConfig) -> None:
        self.waiting: tuple[int, ...] = ()
        self.since_ns = 0
        self.objections: tuple[Fault, ...] = ()
        self.acks: tuple[Ack, ...] = ()
        self.stopped_ns = 0
        self._max_age_ns = safety.request_max_age_ms * 1_000_000
        self._timeout_ns = safety.arm_timeout_ms * 1_000_000
        self._cleared_ns = 0

    def untimely(
        self, request: Arm, now_ns: int, stop_reason: str, *, stopping: bool
    ) -> Fault | None:
        """Return why a request to arm comes too early or too late; None if it does not.

        Parameters
        ----------
        request, now_ns
            The request, and the time [ns].
        stop_reason
            Reason of the last stop, for the answer.
        stopping
            Whether an emergency stop arrives in the same tick.
        """
        if request.stamp_ns < now_ns - self._max_age_ns:
            return Fault(FaultCode.REQUEST_TOO_OLD, "too old")
        if request.stamp_ns > now_ns:
            return Fault(FaultCode.REQUEST_TOO_EARLY, "of the future")
        if stopping or request.stamp_ns <= self.stopped_ns:
            return _before_stop(stop_reason)
        return None

    def wait(self, request: Arm, objections: tuple[Fault, ...]) -> None:
        """Let a request wait."""
        self.objections = objections
        if not self.waiting:
            self.since_ns = request.stamp_ns
        self.waiting = (*self.waiting, request.request_id)[-_KEPT:]

    def answer(self, request_id: int, *refusals: Fault) -> None:
        """Answer one request: yes, unless there are reasons against it."""
        ack = Ack(request_id, accepted=not refusals, reasons=refusals)
        self.acks = (*self.acks, ack)[-_KEPT:]

    def answer_waiting(self, *refusals: Fault) -> None:
        """Answer all that wait: yes, unless there are reasons against it."""
        for request_id in self.waiting:
            self.answer(request_id, *refusals)
        self.waiting = ()

    def stop(self, now_ns: int, why: str) -> None:
        """Refuse all that wait: whoever made them did not know of this stop."""
        self.stopped_ns = now_ns
        self.answer_waiting(_before_stop(why))

    def is_overdue(self, now_ns: int) -> bool:
        """Return whether the first that waits has waited for too long."""
        return now_ns - self.since_ns > self._timeout_ns

    def may_clear(self, now_ns: int) -> bool:
        """Return whether the drives' latches may be cleared again, and note that they are."""
        if now_ns - self._cleared_ns <= _CLEAR_INTERVAL_NS:
            return False
        self._cleared_ns = now_ns
        return True


def _before_stop(why: str) -> Fault:
    """Return the answer to a request to arm that was made before a stop."""
    return Fault(FaultCode.REQUEST_BEFORE_STOP, f"made before the stop: {why}")
