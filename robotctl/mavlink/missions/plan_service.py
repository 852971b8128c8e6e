"""A kind of plans as a service: what differs between missions, fences and rally points."""

from __future__ import annotations

from typing import ClassVar, Generic, Protocol, TypeVar

from pymavlink.dialects.v20 import common

from robotctl.mavlink.context import Context, Request
from robotctl.mavlink.globe import Origin
from robotctl.mavlink.missions.item import MissionItem
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import NavigationState, Severity
from robotctl.messages.mavlink_port import Address, Message, Peer


class OfferedPlan(Protocol):
    """A mission, a fence, or rally points of a ground station."""

    @property
    def items(self) -> tuple[MissionItem, ...]:
        """Items as they came."""

    @property
    def content(self) -> bytes:
        """Content of the file that was made of it; empty: there is none."""

    @property
    def crc(self) -> int:
        """CRC-32 by which navigation names it; 0: there is none."""

    @property
    def origin(self) -> Origin | None:
        """Origin by which places on the globe were turned into those of `world`; None: none."""


P = TypeVar("P", bound=OfferedPlan)


class PlanService(Microservice, Generic[P]):
    """Base of the services: how plans of one kind are read, checked, and handed to navigation."""

    kind: ClassVar[int]
    """MAV_MISSION_TYPE."""
    word: ClassVar[str]
    """Name of the kind, for people and in the names of its files."""
    first: ClassVar[int] = 0
    """Number of the plan's first item: those before it are none of its own."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._plan = self.read(b"")

    def read(self, content: bytes) -> P:
        """Return the plan of a file; none of an empty one, or of one that is damaged."""
        raise NotImplementedError

    def check(self, item: MissionItem, seq: int) -> None:
        """Check a single item; `BadItem`: it cannot be taken."""
        raise NotImplementedError

    def plan_of(self, items: list[MissionItem]) -> tuple[P, list[str]]:
        """Return what all items mean, with notes for people; `BadItem`: nothing allowed."""
        raise NotImplementedError

    def request(self, plan: P, file: str, now_ns: int) -> Request:
        """Return the request to navigation to take a plan, which is kept in a file."""
        raise NotImplementedError

    def is_taken(self, plan: P, navigation: NavigationState) -> bool:
        """Return whether navigation has a plan."""
        raise NotImplementedError

    def may_offer(self, navigation: NavigationState) -> bool:  # noqa: ARG002
        """Return whether navigation, which has another plan, may be offered that of before."""
        return True

    def listed(self, now_ns: int) -> tuple[MissionItem, ...]:
        """Return the items; none while navigation has another plan, or is silent."""
        navigation = self._context.fresh_navigation(now_ns)
        there = navigation is not None and self.is_taken(self._plan, navigation)
        return self._plan.items if there else ()

    def seq(self, now_ns: int) -> int:  # noqa: ARG002
        """Return the number of the present item; -1: there is no such thing."""
        return -1

    def always(self) -> tuple[MissionItem, ...]:
        """Return what may be read where there is no plan."""
        return ()

    def take_single(self, message: Message, peer: Peer, now_ns: int) -> int:  # noqa: ARG002
        """Take an item that is no part of a plan; return MAV_MISSION_RESULT."""
        return int(common.MAV_MISSION_UNSUPPORTED)

    @property
    def hidden(self) -> int:
        """Number of leading items that stations do not see: they count from the next one."""
        return 0

    def hidden_items(self) -> list[MissionItem]:
        """Return the leading items that stations do not see."""
        return []

    @property
    def plan(self) -> P:
        """The last plan that was navigation's."""
        return self._plan

    def adopt(self, plan: P, navigation: NavigationState) -> None:  # noqa: ARG002
        """Note that a plan is navigation's."""
        self._plan = plan
        if plan.origin is None:
            self._context.origin_users.discard(self.word)
        else:
            self._context.origin_users.add(self.word)

    def say(self, now_ns: int, text: str, severity: Severity = Severity.WARNING) -> None:
        """Tell people something about plans of this kind."""
        self._context.say(now_ns, f"{self.word.capitalize()}: {text}", severity)

    def acknowledge(
        self, partner: Address, peer: Peer, result: int, kind: int | None = None
    ) -> None:
        """Send MISSION_ACK; `kind`: another than this one."""
        ack = common.MAVLink_mission_ack_message(
            *partner, result, self.kind if kind is None else kind
        )
        self._context.links.reply(ack, peer)
