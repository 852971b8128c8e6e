"""Requests to arm: those that wait, and the last answer."""

from __future__ import annotations

from typing import Final

from robotctl.messages.control import Ack, Arm
from robotctl.messages.faults import Fault

_KEPT: Final = 8
"""Maximum of waiting requests and of answers: more than arrive within one publishing period."""


class ArmRequests:
    """Requests to arm without an answer, and the latest answers.

    Attributes
    ----------
    waiting
        `request_id`s that wait, in order of arrival.
    since_ns
        When the first of them arrived [ns]: later ones do not postpone the answer.
    acks
        The last answers to any `Arm`, the newest last.
    """

    def __init__(self) -> None:
        self.waiting: tuple[int, ...] = ()
        self.since_ns = 0
        self.acks: tuple[Ack, ...] = ()

    def wait(self, request: Arm) -> None:
        """Let a request wait."""
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
