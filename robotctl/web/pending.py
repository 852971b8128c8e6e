"""Requests that the robot was handed, until it has done as asked or their time is over."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from robotctl.messages.mode import Mode
from robotctl.web.plan_uploads import Offered
from robotctl.web.published import (
    BoundsView,
    ControlState,
    NavigationState,
    ParameterAnswer,
    Published,
)
from robotctl.web.robot_view import RobotView
from robotctl.web.wire import Refused

ANSWER_NS: Final = 1_500_000_000
"""Time that navigation has to be in a mode that was asked for [ns]."""


@dataclass(frozen=True, slots=True)
class Asked:
    """Request that waits for its answer."""

    client: int
    number: int
    deadline_ns: int


class Pending:
    """Requests to each process; tells clients which it has refused.

    Parameters
    ----------
    robot
        Newest states of the robot.
    tell
        Takes refusals for a client.

    Attributes
    ----------
    taken
        Plans that navigation has now, since they were last asked for.
    """

    def __init__(self, robot: RobotView, tell: Callable[[int, Refused], None]) -> None:
        self._robot = robot
        self._tell = tell
        self.taken: list[Offered] = []
        self._numbered: dict[int, tuple[str, Asked]] = {}
        """Process that has to answer each request, by the request's number."""
        self._last = 0
        self._mode: tuple[Asked, Mode] | None = None
        self._orders: dict[int, tuple[Asked, int]] = {}
        """Orders to the mission by client, with the count of those done before."""
        self._plans: dict[str, tuple[Asked, Offered]] = {}
        """Plans that navigation has still to take, by their kind."""

    def number(self, process: str, asked: Asked, stamp_ns: int) -> int:
        """Return a new number for a request that a process answers by it."""
        self._last = max(self._last + 1, stamp_ns)
        self._numbered[self._last] = process, asked
        return self._last

    def mode(self, asked: Asked, mode: Mode) -> None:
        """Wait for a mode, in place of any other."""
        self._mode = asked, mode

    def order(self, asked: Asked) -> None:
        """Wait until the mission has done one more of its orders."""
        navigation = self._robot.navigation
        self._orders[asked.client] = asked, 0 if navigation is None else navigation.mission_commands

    def plan(self, asked: Asked, plan: Offered) -> None:
        """Wait until navigation has a plan."""
        if (waiting := self._plans.get(plan.kind)) is not None:
            self._refuse(waiting[0], "another one came behind it")
        self._plans[plan.kind] = asked, plan

    def hear(self, message: Published) -> None:
        """Take note of what the robot has done, and what it refuses."""
        match message:
            case ControlState():
                for ack in message.acks:
                    _, asked = self._numbered.pop(ack.request_id, ("", None))
                    if asked is not None and not ack.accepted:
                        self._refuse(asked, "; ".join(map(str, ack.reasons)) or "refused")
            case ParameterAnswer():
                _, asked = self._numbered.pop(message.request_id, ("", None))
                if asked is not None and message.refusal:
                    self._refuse(asked, message.refusal)
            case NavigationState():
                if self._mode is not None and self._mode[1] == message.mode:
                    self._mode = None
                done = message.mission_commands
                self._orders = {who: each for who, each in self._orders.items() if each[1] == done}
                self._note_plan("mission", message.mission_crc)
                self._note_plan("fence", message.fence.crc)
            case BoundsView():
                self._note_plan("zones", message.zones_crc)

    def step(self, now_ns: int) -> None:
        """Tell clients what has not been done in time."""
        for number, (process, asked) in list(self._numbered.items()):
            if now_ns > asked.deadline_ns:
                del self._numbered[number]
                self._refuse(asked, f"{process} does not answer")
        if self._mode is not None and now_ns > self._mode[0].deadline_ns:
            asked, mode = self._mode
            self._mode = None
            self._refuse(asked, self._robot.why_not(mode))
        navigation = self._robot.navigation
        why = navigation.message if navigation is not None else "navigation does not answer"
        for client, (asked, _) in list(self._orders.items()):
            if now_ns > asked.deadline_ns:
                del self._orders[client]
                self._refuse(asked, why or "navigation did nothing")
        for kind, (asked, _) in list(self._plans.items()):
            if now_ns > asked.deadline_ns:
                del self._plans[kind]
                self._refuse(asked, f"the robot has not taken it: {why or 'see the notices'}")

    def _note_plan(self, kind: str, crc: int) -> None:
        """Note which plan of a kind navigation has."""
        waiting = self._plans.get(kind)
        if waiting is not None and waiting[1].crc == crc:
            del self._plans[kind]
            self.taken.append(waiting[1])

    def _refuse(self, asked: Asked, why: str) -> None:
        self._tell(asked.client, Refused(asked.number, why))
