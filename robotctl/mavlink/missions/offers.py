"""Plans on their way to navigation, which takes or refuses them one after the other."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Generic

from pymavlink.dialects.v20 import common

from robotctl.mavlink.context import Answer, Context, PlanStore
from robotctl.mavlink.missions.plan_service import P, PlanService
from robotctl.messages.control import NavigationState, Severity

ACCEPTED: Final[int] = common.MAV_MISSION_ACCEPTED
DENIED: Final[int] = common.MAV_MISSION_DENIED
ANSWER_NS: Final = 1_200_000_000
"""Maximum time in which navigation takes a plan [ns]: it drops requests that are 1 s old, and
QGroundControl waits 1.5 s for the answer."""
MOST_ANSWERS: Final = 32
"""Invented stations must not fill the memory."""


@dataclass(slots=True)
class _Offer(Generic[P]):
    """A plan, or none, that navigation is to take."""

    plan: P
    notes: list[str]
    answers: list[Answer]
    """Answers to all who wait for the result; empty for a plan from before a restart."""
    asked_ns: int | None = None
    """When navigation was asked [ns]; None: others come first."""


class Offers(Generic[P]):
    """The plans of one kind that navigation has still to take, in the order in which they came.

    Navigation tells only which plan it has, so it is asked for one at a time. Each answer is that
    of its own plan.

    Parameters
    ----------
    context
        Takes requests and texts.
    kind
        How navigation is asked, and whether it has taken the plan.
    store
        Keeps plans over a restart.
    """

    def __init__(self, context: Context, kind: PlanService[P], store: PlanStore) -> None:
        self._context = context
        self._kind = kind
        self._store = store
        self._queue: deque[_Offer[P]] = deque()

    @property
    def are_pending(self) -> bool:
        """Whether navigation has not decided on all of them."""
        return bool(self._queue)

    def add(self, plan: P, notes: list[str], answers: Sequence[Answer], now_ns: int) -> None:
        """Offer a plan once those before it are decided.

        Who clears a plan while somebody else does the same gets the same answer.
        """
        last = self._queue[-1] if self._queue else None
        if last is None or last.plan.content or plan.content:
            self._queue.append(_Offer(plan, notes, list(answers)))
            self._ask_first(now_ns)
        elif len(last.answers) < MOST_ANSWERS:
            last.answers.extend(answers)
        else:
            _tell(answers, DENIED)

    def step(self, now_ns: int) -> None:
        """Answer what navigation has taken, or has not in time; ask for the next."""
        navigation = self._context.fresh_navigation(now_ns)
        if self._queue and (asked_ns := self._queue[0].asked_ns) is not None:
            offer = self._queue[0]
            heard = navigation is not None and navigation.stamp_ns > asked_ns
            if navigation is not None and heard and self._kind.is_taken(offer.plan, navigation):
                self._queue.popleft()
                self._succeed(offer, navigation, now_ns)
            elif now_ns - asked_ns > ANSWER_NS:
                self._queue.popleft()
                self._fail(offer, navigation, now_ns)
        self._ask_first(now_ns)

    def _ask_first(self, now_ns: int) -> None:
        """Ask navigation to take the first plan, from the file in which it outlives a power cut."""
        if not self._queue or self._queue[0].asked_ns is not None:
            return
        offer = self._queue[0]
        offer.asked_ns = now_ns
        content = offer.plan.content
        path = self._store.save(content) if content else ""
        if content and not path:
            self._say(now_ns, ": cannot be saved, a restart will lose it")
        self._context.requests.append(self._kind.request(offer.plan, path, now_ns))

    def _succeed(self, offer: _Offer[P], navigation: NavigationState, now_ns: int) -> None:
        self._kind.adopt(offer.plan, navigation)
        self._store.keep(offer.plan.content)
        for note in offer.notes:
            self._say(now_ns, f": {note}", Severity.NOTICE)
        _tell(offer.answers, ACCEPTED)

    def _fail(self, offer: _Offer[P], navigation: NavigationState | None, now_ns: int) -> None:
        why = "navigation is silent" if navigation is None else navigation.message
        self._say(now_ns, f" not taken: {why}")
        self._store.keep(self._kind.plan.content)
        _tell(offer.answers, DENIED)

    def _say(self, now_ns: int, text: str, severity: Severity = Severity.WARNING) -> None:
        self._context.say(now_ns, f"{self._kind.word.capitalize()}{text}", severity)


def _tell(answers: Sequence[Answer], result: int) -> None:
    for answer in answers:
        answer(result)
