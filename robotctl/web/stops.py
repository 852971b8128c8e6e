"""Emergency stops that clients asked for: repeated until control shows that it has stopped."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from robotctl.messages.control import SafetyState
from robotctl.web.published import ControlState
from robotctl.web.wire import StopSeen

STOPPED: Final = frozenset({SafetyState.EMERGENCY_STOP, SafetyState.FAULT})
REPEAT_NS: Final = 500_000_000
"""Time without an answer after which a stop is repeated, and that is said [ns]."""
NO_ANSWER: Final = "control does not answer; the stop is being repeated"


@dataclass(slots=True)
class _Pending:
    """Stop of a connection: its number, when it came, and was last sent [ns, server's clock]."""

    connection: object
    number: int
    asked_ns: int
    stamp_ns: int
    """Time of the stop by the robot's clock; only a later state answers it."""
    sent_ns: int


class Stops:
    """Stops that control has not answered yet.

    They outlive the connection that asked for them.
    """

    def __init__(self) -> None:
        self._pending: list[_Pending] = []
        self._answers: list[tuple[object, StopSeen]] = []

    @property
    def is_pending(self) -> bool:
        """Whether a stop is not answered yet."""
        return bool(self._pending)

    def take_answers(self) -> list[tuple[object, StopSeen]]:
        """Return what connections are to be told, since the last call."""
        answers, self._answers = self._answers, []
        return answers

    def ask(self, connection: object, number: int, server_ns: int, robot_ns: int) -> None:
        """Remember a stop that is being sent now."""
        self._pending.append(_Pending(connection, number, server_ns, robot_ns, server_ns))

    def hear(self, control: ControlState, server_ns: int) -> None:
        """Answer the stops that a state of the robot shows."""
        if control.state not in STOPPED:
            return
        for stop in self._pending:
            if control.stamp_ns > stop.stamp_ns:
                self._answer(stop, control.state, control.reason, server_ns)
        self._pending = [each for each in self._pending if control.stamp_ns <= each.stamp_ns]

    def step(self, server_ns: int) -> bool:
        """Return whether a stop is to be sent again."""
        due = [each for each in self._pending if server_ns - each.sent_ns > REPEAT_NS]
        for stop in due:
            stop.sent_ns = server_ns
            self._answer(stop, None, NO_ANSWER, server_ns)
        return bool(due)

    def _answer(self, stop: _Pending, state: int | None, reason: str, server_ns: int) -> None:
        after_ms = (server_ns - stop.asked_ns) / 1e6
        seen = StopSeen(stop.number, state, reason, after_ms)
        self._answers.append((stop.connection, seen))
