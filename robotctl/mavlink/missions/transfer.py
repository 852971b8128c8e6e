"""The mission protocol for one kind of plan: missions, fences and rally points are kept apart.

The plan changes only when a whole one has come and navigation has taken it: an upload that ends
early leaves the old one. https://mavlink.io/en/services/mission.html.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Final, Generic, Protocol, TypeVar

from pymavlink.dialects.v20 import common

from robotctl.mavlink.context import Context, Request
from robotctl.mavlink.globe import Origin
from robotctl.mavlink.missions.item import MissionItem, item_of, message_of
from robotctl.mavlink.missions.translate import BadItem
from robotctl.mavlink.missions.upload import Upload
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import NavigationState, Severity
from robotctl.messages.mavlink_port import Message, Peer, source

MISSION: Final[int] = common.MAV_MISSION_TYPE_MISSION
ALL: Final[int] = common.MAV_MISSION_TYPE_ALL
MOST_ITEMS: Final = 1000
ANSWER_NS: Final = 1_500_000_000
"""Navigation has this long to take a plan [ns]."""
GUIDED_ITEM: Final = 2
"""`current` of an item that is no part of a mission but a place to go to at once."""
OTHERS: Final = frozenset({common.MAV_MISSION_TYPE_FENCE, common.MAV_MISSION_TYPE_RALLY})
"""Kinds that have a service, beside missions."""


class Plan(Protocol):
    """What a ground station has sent."""

    @property
    def items(self) -> tuple[MissionItem, ...]:
        """As they came."""

    @property
    def content(self) -> bytes:
        """The file that was made of it; empty: there is none."""

    @property
    def crc(self) -> int:
        """As navigation tells it; 0: there is none."""

    @property
    def origin(self) -> Origin | None:
        """By which places on the globe were turned into those of `world`; None: there are none."""


P = TypeVar("P", bound=Plan)


@dataclass(frozen=True, slots=True)
class Offer(Generic[P]):
    """A plan, or none, that navigation is asked to take."""

    plan: P
    notes: list[str]
    partner: tuple[int, int]
    peer: Peer | None
    """None: it is offered again, and nobody waits for an answer."""
    asked_ns: int


class Transfer(Microservice, Generic[P]):
    """Takes plans of one kind from one ground station at a time, and gives them to all."""

    handles = frozenset(
        {
            common.MAVLINK_MSG_ID_MISSION_COUNT,
            common.MAVLINK_MSG_ID_MISSION_ITEM_INT,
            common.MAVLINK_MSG_ID_MISSION_ITEM,
            common.MAVLINK_MSG_ID_MISSION_REQUEST_LIST,
            common.MAVLINK_MSG_ID_MISSION_REQUEST_INT,
            common.MAVLINK_MSG_ID_MISSION_REQUEST,
            common.MAVLINK_MSG_ID_MISSION_CLEAR_ALL,
            common.MAVLINK_MSG_ID_MISSION_WRITE_PARTIAL_LIST,
        }
    )
    kind: ClassVar[int]
    """MAV_MISSION_TYPE."""
    word: ClassVar[str]
    """For people, and of its files."""
    first: ClassVar[int] = 0
    """Number of its first item: others before it are none of the plan's own."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._plan = self.read(b"")
        self._store = context.store_of(self.word)
        self._saved = self._store.load()
        """The file of before this process began."""
        self._upload: Upload | None = None
        self._offer: Offer[P] | None = None
        self._answered: tuple[tuple[int, int], int] | None = None
        """Whose upload was answered last, and how: the answer may have been lost."""
        self._take: dict[int, Any] = {
            common.MAVLINK_MSG_ID_MISSION_COUNT: self._begin,
            common.MAVLINK_MSG_ID_MISSION_ITEM_INT: self._take_item,
            common.MAVLINK_MSG_ID_MISSION_ITEM: self._take_item,
            common.MAVLINK_MSG_ID_MISSION_REQUEST_LIST: self._tell_count,
            common.MAVLINK_MSG_ID_MISSION_REQUEST_INT: self._tell_item,
            common.MAVLINK_MSG_ID_MISSION_REQUEST: self._tell_item,
            common.MAVLINK_MSG_ID_MISSION_CLEAR_ALL: self._clear,
            common.MAVLINK_MSG_ID_MISSION_WRITE_PARTIAL_LIST: self._begin_part,
        }

    # What differs between the kinds.

    def read(self, content: bytes) -> P:
        """Return the plan of a file; none of an empty one, or of one that is damaged."""
        raise NotImplementedError

    def check(self, item: MissionItem, seq: int) -> None:
        """Check one item by itself; `BadItem`: it cannot be taken."""
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
        """Items at the beginning that stations do not know of: they count from the one behind."""
        return 0

    def hidden_items(self) -> list[MissionItem]:
        """Return what stands for them in a plan."""
        return []

    def adopt(self, plan: P, navigation: NavigationState) -> None:  # noqa: ARG002
        """Note that a plan is navigation's."""
        self._plan = plan
        if plan.origin is None:
            self._context.origin_users.discard(self.word)
        else:
            self._context.origin_users.add(self.word)

    # The protocol.

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Take a message about this kind; a mission's service refuses unknown kinds."""
        kind = getattr(message, "mission_type", MISSION)
        if kind == self.kind or (kind == ALL and message.get_type() == "MISSION_CLEAR_ALL"):
            self._take[message.get_msgId()](message, peer, now_ns)
        elif self.kind == MISSION and kind not in OTHERS:
            ack = common.MAVLink_mission_ack_message(
                *source(message), common.MAV_MISSION_UNSUPPORTED, kind
            )
            self._context.links.reply(ack, peer)

    def step(self, now_ns: int) -> None:
        """Ask again for what has not come; answer what navigation has taken."""
        upload = self._upload
        if upload is not None and upload.asks_again(now_ns):
            if upload.is_given_up:
                self._upload = None
                self._say(now_ns, "the upload was given up, the old one stays")
                self._answer(common.MAV_MISSION_OPERATION_CANCELLED, upload)
            else:
                self._ask(upload)
        navigation = self._context.fresh_navigation(now_ns)
        if self._offer is not None:
            self._follow(self._offer, navigation, now_ns)
        elif self._saved and navigation is not None:
            self._offer_again(navigation, now_ns)

    def _say(self, now_ns: int, text: str, severity: Severity = Severity.WARNING) -> None:
        self._context.say(now_ns, f"{self.word.capitalize()}: {text}", severity)

    # Upload.

    def _begin(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Begin an upload, or begin it anew."""
        partner, count = source(message), message.count + self.hidden
        if self._is_busy(partner):
            self._acknowledge(common.MAV_MISSION_DENIED, partner, peer)
        elif message.count > MOST_ITEMS:
            self._say(now_ns, f"{message.count} items, {MOST_ITEMS} allowed")
            self._acknowledge(common.MAV_MISSION_NO_SPACE, partner, peer)
        elif count <= self.first:
            self._clear(message, peer, now_ns)
        else:
            self._upload = Upload(partner, peer, count, now_ns, self.hidden_items())
            self._ask(self._upload)

    def _begin_part(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Begin to replace some items of the plan, which counts once it is checked as a whole."""
        partner, items = source(message), self.listed(now_ns)
        first, last = message.start_index + self.hidden, message.end_index + self.hidden
        if self._is_busy(partner):
            self._acknowledge(common.MAV_MISSION_DENIED, partner, peer)
        elif not self.hidden <= first <= last < len(items):
            found = f"{message.start_index} to {message.end_index}"
            self._say(now_ns, f"no items {found} to replace")
            self._acknowledge(common.MAV_MISSION_INVALID_SEQUENCE, partner, peer)
        else:
            self._upload = Upload(partner, peer, last + 1, now_ns, items[:first], items[last + 1 :])
            self._ask(self._upload)

    def _is_busy(self, partner: tuple[int, int]) -> bool:
        """Return whether another station's upload, or navigation's answer, has to be waited for."""
        upload = self._upload
        return self._offer is not None or (upload is not None and upload.partner != partner)

    def _ask(self, upload: Upload) -> None:
        """Ask for the next item."""
        make = common.MAVLink_mission_request_int_message
        if upload.asks_old:
            make = common.MAVLink_mission_request_message
        request = make(*upload.partner, upload.wanted - self.hidden, self.kind)
        self._context.links.reply(request, upload.peer)

    def _take_item(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Take an item if it is the next; repeat the answer to a sender that has not heard it."""
        partner, upload = source(message), self._upload
        if message.current >= GUIDED_ITEM:
            self._acknowledge(self.take_single(message, peer, now_ns), partner, peer)
        elif upload is None or upload.partner != partner:
            if self._answered is not None and self._answered[0] == partner:
                self._acknowledge(self._answered[1], partner, peer)
        elif message.seq + self.hidden == upload.wanted:
            self._add(upload, item_of(message, self.hidden), now_ns)
        elif message.seq + self.hidden > upload.wanted:
            self._ask(upload)

    def _add(self, upload: Upload, item: MissionItem, now_ns: int) -> None:
        """Add an item that is as it must be; offer the plan once it is whole."""
        try:
            if upload.wanted >= self.first:
                self.check(item, upload.wanted)
            upload.take(item, now_ns)
            if not upload.is_complete:
                self._ask(upload)
                return
            plan, notes = self.plan_of(upload.whole)
        except BadItem as error:
            self._upload = None
            self._say(now_ns, f"item {error.seq - self.hidden}: {error.why}")
            self._answer(error.result, upload)
            return
        self._upload = None
        self._ask_for(Offer(plan, notes, upload.partner, upload.peer, now_ns))

    def _clear(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Ask navigation to have no plan of this kind.

        Of all kinds at once, that of missions answers.
        """
        waits = getattr(message, "mission_type", MISSION) != ALL or self.kind == MISSION
        if self._is_busy(source(message)):
            if waits:
                self._acknowledge(common.MAV_MISSION_DENIED, source(message), peer)
            return
        self._upload = None
        asked_by = peer if waits else None
        self._ask_for(Offer(self.read(b""), [], source(message), asked_by, now_ns))

    def _ask_for(self, offer: Offer[P]) -> None:
        """Ask navigation to take a plan, from the file in which it outlives a power cut."""
        self._offer = offer
        content = offer.plan.content
        path = self._store.save(content) if content else ""
        if content and not path:
            self._say(offer.asked_ns, "cannot be saved, a restart will lose it")
        self._context.requests.append(self.request(offer.plan, path, offer.asked_ns))

    def _follow(self, offer: Offer[P], navigation: NavigationState | None, now_ns: int) -> None:
        """Answer once navigation has taken a plan, or has not in time."""
        heard = navigation is not None and navigation.stamp_ns > offer.asked_ns
        if navigation is not None and heard and self.is_taken(offer.plan, navigation):
            self._offer = None
            self.adopt(offer.plan, navigation)
            self._store.keep(offer.plan.content)
            for note in offer.notes:
                self._say(now_ns, note, Severity.NOTICE)
            self._answer(common.MAV_MISSION_ACCEPTED, offer)
            return
        if now_ns - offer.asked_ns > ANSWER_NS:
            why = "navigation is silent" if navigation is None else navigation.message
            self._context.say(now_ns, f"{self.word.capitalize()} not taken: {why}")
            self._offer = None
            self._store.keep(self._plan.content)
            self._answer(common.MAV_MISSION_DENIED, offer)

    def _offer_again(self, navigation: NavigationState, now_ns: int) -> None:
        """Offer the plan of before a power cut to a robot that has none."""
        content, self._saved = self._saved, b""
        plan = self.read(content)
        if not plan.content:
            return
        if plan.origin is not None and self._context.origin not in {None, plan.origin}:
            self._say(now_ns, "that of before is of another origin, left out")
            return
        self._context.origin = self._context.origin or plan.origin
        if self.is_taken(plan, navigation):
            self.adopt(plan, navigation)
        elif self.may_offer(navigation):
            self._ask_for(Offer(plan, [], (0, 0), None, now_ns))

    def _answer(self, result: int, asked: Upload | Offer[P]) -> None:
        """End an upload; the same answer goes to who repeats the last item."""
        if asked.peer is not None:
            self._answered = asked.partner, result
            self._acknowledge(result, asked.partner, asked.peer)

    def _acknowledge(self, result: int, partner: tuple[int, int], peer: Peer) -> None:
        ack = common.MAVLink_mission_ack_message(*partner, result, self.kind)
        self._context.links.reply(ack, peer)

    # Download.

    def _tell_count(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Say how many items there are."""
        count = max(len(self.listed(now_ns)) - self.hidden, 0)
        answer = common.MAVLink_mission_count_message(*source(message), count, self.kind)
        self._context.links.reply(answer, peer)

    def _tell_item(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Send one item in the form in which it is asked for."""
        items, seq = self.listed(now_ns) or self.always(), message.seq + self.hidden
        if not seq < len(items):
            self._acknowledge(common.MAV_MISSION_INVALID_SEQUENCE, source(message), peer)
            return
        whole = message.get_msgId() == common.MAVLINK_MSG_ID_MISSION_REQUEST_INT
        current = seq == self.seq(now_ns)
        answer = message_of(
            items[seq],
            seq,
            source(message),
            current=current,
            whole=whole,
            kind=self.kind,
            hidden=self.hidden,
        )
        self._context.links.reply(answer, peer)
