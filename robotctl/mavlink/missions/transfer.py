"""The mission protocol for one kind of plan: missions, fences and rally points are kept apart.

Of each kind one station uploads at a time, and all may read. The state is

| | an upload is | navigation is |
|---|---|---|
| idle | not there | not asked |
| waiting | there, nothing of it is requested yet | asked for what came before |
| receiving | there, `Upload.wanted` is requested again and again | not asked |
| deciding | not there | asked for a plan that came, or for none |

and for each station how its last upload ended, and what it reads (`Stations`). So the answers to
one station come in the order of its requests: a clear's ACCEPTED is never that of the upload behind
it. Every upload ends: with its last item, a refusal, an error or clear of the station, or
`LONGEST_NS` without the wanted item. Navigation's answer takes `ANSWER_NS` at most.

The plan changes only when a whole one has come and navigation has taken it: an upload that ends
early leaves the old one. https://mavlink.io/en/services/mission.html.
"""

from __future__ import annotations

from functools import partial
from typing import Any, ClassVar, Final, Generic

from pymavlink.dialects.v20 import common

from robotctl.mavlink.context import Answer, Context, Request
from robotctl.mavlink.missions.item import MissionItem, item_of, message_of
from robotctl.mavlink.missions.offers import ACCEPTED, DENIED, Offers, P
from robotctl.mavlink.missions.stations import MOST_STATIONS, Stations
from robotctl.mavlink.missions.translate import BadItem
from robotctl.mavlink.missions.upload import Upload
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import NavigationState, Severity
from robotctl.messages.mavlink_port import Address, Message, Peer, source

MISSION: Final[int] = common.MAV_MISSION_TYPE_MISSION
ALL: Final[int] = common.MAV_MISSION_TYPE_ALL
MOST_ITEMS: Final = 1000
GUIDED_ITEM: Final = 2
"""`current` of an item that is no part of a mission but a place to go to at once."""
OTHERS: Final = frozenset({common.MAV_MISSION_TYPE_FENCE, common.MAV_MISSION_TYPE_RALLY})
"""Kinds that have a service, beside missions."""
_CANCELLED: Final[int] = common.MAV_MISSION_OPERATION_CANCELLED


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
            common.MAVLINK_MSG_ID_MISSION_ACK,
        }
    )
    kind: ClassVar[int]
    """MAV_MISSION_TYPE."""
    word: ClassVar[str]
    """Name of the kind, for people and in the names of its files."""
    first: ClassVar[int] = 0
    """Number of the plan's first item: those before it are none of its own."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._plan = self.read(b"")
        store = context.store_of(self.word)
        self._saved = store.load()
        """The file of before this process began."""
        self._upload: Upload | None = None
        self._offers: Offers[P] = Offers(context, self, store)
        self._stations = Stations()
        self._listing: dict[Address, Peer] = {}
        """Stations that asked for the list while navigation decides."""
        context.clears.append(self.clear)
        self._take: dict[int, Any] = {
            common.MAVLINK_MSG_ID_MISSION_COUNT: self._begin,
            common.MAVLINK_MSG_ID_MISSION_ITEM_INT: self._take_item,
            common.MAVLINK_MSG_ID_MISSION_ITEM: self._take_item,
            common.MAVLINK_MSG_ID_MISSION_REQUEST_LIST: self._tell_count,
            common.MAVLINK_MSG_ID_MISSION_REQUEST_INT: self._tell_item,
            common.MAVLINK_MSG_ID_MISSION_REQUEST: self._tell_item,
            common.MAVLINK_MSG_ID_MISSION_CLEAR_ALL: self._clear,
            common.MAVLINK_MSG_ID_MISSION_WRITE_PARTIAL_LIST: self._begin_part,
            common.MAVLINK_MSG_ID_MISSION_ACK: self._take_ack,
        }

    # What differs between the kinds.

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
        """Items at the beginning that stations do not know of: they count from the one behind."""
        return 0

    def hidden_items(self) -> list[MissionItem]:
        """Return what stands for them in a plan."""
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

    # The protocol.

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Take a message about this kind; a mission's service refuses unknown kinds."""
        kind = getattr(message, "mission_type", MISSION)
        if kind == self.kind:
            self._take[message.get_msgId()](message, peer, now_ns)
        elif self.kind == MISSION and kind not in OTHERS:
            if kind == ALL and message.get_type() == "MISSION_CLEAR_ALL":
                self._clear_all_kinds(source(message), peer, now_ns)
            elif message.get_type() != "MISSION_ACK":  # two systems would answer each other forever
                self._acknowledge(source(message), peer, common.MAV_MISSION_UNSUPPORTED, kind)

    def step(self, now_ns: int) -> None:
        """Answer what navigation has taken; ask for what has not come."""
        self._offers.step(now_ns)
        if not self._offers.are_pending:
            self._go_on(now_ns)
        navigation = self._context.fresh_navigation(now_ns)
        if self._saved and navigation is not None and not self._offers.are_pending:
            self._offer_again(navigation, now_ns)

    def _go_on(self, now_ns: int) -> None:
        """Answer what came while navigation decided; ask for what has not come."""
        for partner, peer in self._listing.items():
            self._count(partner, peer, now_ns)
        self._listing.clear()
        upload = self._upload
        if upload is not None:
            if upload.is_given_up(now_ns):
                self._say(now_ns, "the upload was given up, the old one stays")
                self._end(upload, _CANCELLED)
            elif upload.is_due(now_ns):
                upload.note_request(now_ns)
                self._request(upload)

    def _say(self, now_ns: int, text: str, severity: Severity = Severity.WARNING) -> None:
        self._context.say(now_ns, f"{self.word.capitalize()}: {text}", severity)

    # Upload.

    def _begin(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Begin an upload, or restart it."""
        partner = source(message)
        if not self._yields(partner):
            self._acknowledge(partner, peer, DENIED)
        elif message.count > MOST_ITEMS:
            self._say(now_ns, f"{message.count} items, {MOST_ITEMS} allowed")
            self._acknowledge(partner, peer, common.MAV_MISSION_NO_SPACE)
        elif message.count == 0:
            self._clear(message, peer, now_ns)
        else:
            count = message.count + self.hidden
            self._upload = Upload(partner, peer, count, now_ns, self.hidden_items())

    def _begin_part(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Begin to replace some items of the plan, which counts once it is checked as a whole.

        Not while navigation decides: the items that stay would be those of before.
        """
        partner, items = source(message), self.listed(now_ns)
        first, last = message.start_index + self.hidden, message.end_index + self.hidden
        if self._offers.are_pending or not self._yields(partner):
            self._acknowledge(partner, peer, DENIED)
        elif not self.hidden <= first <= last < len(items):
            found = f"{message.start_index} to {message.end_index}"
            self._say(now_ns, f"no items {found} to replace")
            self._acknowledge(partner, peer, common.MAV_MISSION_INVALID_SEQUENCE)
        else:
            self._upload = Upload(partner, peer, last + 1, now_ns, items[:first], items[last + 1 :])

    def _yields(self, partner: Address) -> bool:
        """Return whether a station may change the plan; end its own upload of before then."""
        if self._upload is not None and self._upload.partner != partner:
            return False
        self._upload = None
        self._stations.begin_upload(partner)
        return True

    def _request(self, upload: Upload) -> None:
        """Ask for the wanted item."""
        make = common.MAVLink_mission_request_int_message
        if upload.uses_old_request:
            make = common.MAVLink_mission_request_message
        request = make(*upload.partner, upload.wanted - self.hidden, self.kind)
        self._context.links.reply(request, upload.peer)

    def _take_item(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Take an item if it is the one that was requested."""
        partner, upload = source(message), self._upload
        if message.current >= GUIDED_ITEM:
            self._acknowledge(partner, peer, self.take_single(message, peer, now_ns))
        elif upload is None or upload.partner != partner:
            self._answer_stray(message, peer)
        elif message.seq + self.hidden != upload.wanted:
            upload.hurry()
        elif upload.has_requested:
            self._add(upload, item_of(message, self.hidden), now_ns)

    def _answer_stray(self, message: Message, peer: Peer) -> None:
        """Answer an item of a station that does not upload.

        Who repeats the last item of its upload has not heard the answer, and gets it again, once
        there is one; earlier ones are late copies.
        """
        partner = source(message)
        ended, seq = self._stations.ended(partner), message.seq + self.hidden
        if ended is None or seq > ended.seq:
            result = common.MAV_MISSION_ERROR if self._upload is None else DENIED
            self._acknowledge(partner, peer, result)
        elif seq == ended.seq and ended.result is not None:
            self._acknowledge(partner, peer, ended.result)

    def _add(self, upload: Upload, item: MissionItem, now_ns: int) -> None:
        """Add an item that is as it must be; offer the plan once it is whole."""
        try:
            self.check(item, upload.wanted)
            upload.take(item, now_ns)
            if not upload.is_complete:
                return
            plan, notes = self.read(b""), list[str]()
            if len(upload.whole) > self.first:
                plan, notes = self.plan_of(upload.whole)
        except BadItem as error:
            self._say(now_ns, f"item {error.seq - self.hidden}: {error.why}")
            self._end(upload, error.result)
            return
        self._upload = None
        self._stations.end_upload(upload.partner, upload.last, None)
        self._offers.add(plan, notes, [partial(self._end, upload)], now_ns)

    def _end(self, upload: Upload, result: int) -> None:
        """Answer an upload that has ended, unless its station has begun another one."""
        if self._upload is upload:
            self._upload = None
        self._stations.end_upload(upload.partner, upload.last, result)
        self._acknowledge(upload.partner, upload.peer, result)

    def _take_ack(self, message: Message, peer: Peer, now_ns: int) -> None:  # noqa: ARG002
        """End what a station reads, or with an error its upload, for which there is no answer."""
        partner, upload = source(message), self._upload
        self._stations.end_reading(partner)
        if message.type != ACCEPTED and upload is not None and upload.partner == partner:
            self._upload = None
            self._stations.end_upload(partner, upload.last, None)

    # Clearing.

    def _clear(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Clear the plan for a station."""
        partner = source(message)
        self.clear(partner, partial(self._acknowledge, partner, peer), now_ns)

    def clear(self, partner: Address, answer: Answer, now_ns: int) -> None:
        """Ask navigation to have no plan of this kind."""
        if self._yields(partner):
            self._offers.add(self.read(b""), [], [answer], now_ns)
        else:
            answer(DENIED)

    def _clear_all_kinds(self, partner: Address, peer: Peer, now_ns: int) -> None:
        """Clear all plans, and answer once with the first refusal, else with ACCEPTED."""
        clears, results = self._context.clears, list[int]()

        def answer(result: int) -> None:
            results.append(result)
            if len(results) == len(clears):
                worst = next((each for each in results if each != ACCEPTED), ACCEPTED)
                self._acknowledge(partner, peer, worst, ALL)

        for clear in clears:
            clear(partner, answer, now_ns)

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
            self._offers.add(plan, [], [], now_ns)

    def _acknowledge(
        self, partner: Address, peer: Peer, result: int, kind: int | None = None
    ) -> None:
        ack = common.MAVLink_mission_ack_message(
            *partner, result, self.kind if kind is None else kind
        )
        self._context.links.reply(ack, peer)

    # Download.

    def _tell_count(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Say how many items there are, once navigation has decided on what came before."""
        partner = source(message)
        if not self._offers.are_pending:
            self._count(partner, peer, now_ns)
        elif len(self._listing) < MOST_STATIONS:
            self._listing[partner] = peer

    def _count(self, partner: Address, peer: Peer, now_ns: int) -> None:
        """Say how many items there are; the station then reads them whatever comes meanwhile."""
        items = self.listed(now_ns)
        self._stations.begin_reading(partner, items, now_ns)
        count = max(len(items) - self.hidden, 0)
        self._context.links.reply(
            common.MAVLink_mission_count_message(*partner, count, self.kind), peer
        )

    def _tell_item(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Send one item in the form in which it is asked for."""
        partner, seq = source(message), message.seq + self.hidden
        items = self._stations.reads(partner, now_ns) or self.listed(now_ns) or self.always()
        if not seq < len(items):
            self._acknowledge(partner, peer, common.MAV_MISSION_INVALID_SEQUENCE)
            return
        whole = message.get_msgId() == common.MAVLINK_MSG_ID_MISSION_REQUEST_INT
        current = seq == self.seq(now_ns)
        answer = message_of(
            items[seq],
            seq,
            partner,
            current=current,
            whole=whole,
            kind=self.kind,
            hidden=self.hidden,
        )
        self._context.links.reply(answer, peer)
