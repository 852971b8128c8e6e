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

from typing import Any, Final

from pymavlink.dialects.v20 import common

from robotctl.mavlink.context import Context
from robotctl.mavlink.missions.downloads import Downloads
from robotctl.mavlink.missions.offers import ACCEPTED, Offers
from robotctl.mavlink.missions.plan_service import P, PlanService
from robotctl.mavlink.missions.stations import Stations
from robotctl.mavlink.missions.uploads import Uploads
from robotctl.messages.control import NavigationState
from robotctl.messages.mavlink_port import Address, Message, Peer, source

MISSION: Final[int] = common.MAV_MISSION_TYPE_MISSION
ALL: Final[int] = common.MAV_MISSION_TYPE_ALL
OTHERS: Final = frozenset({common.MAV_MISSION_TYPE_FENCE, common.MAV_MISSION_TYPE_RALLY})
"""Kinds that have a service, beside missions."""


class Transfer(PlanService[P]):
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

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        store = context.store_of(self.word)
        self._saved = store.load()
        """File from before this process began."""
        self._offers: Offers[P] = Offers(context, self, store)
        stations = Stations()
        self._uploads = uploads = Uploads(context, self, stations, self._offers)
        self._downloads = downloads = Downloads(context, self, stations, self._offers)
        context.clears.append(uploads.clear)
        self._take: dict[int, Any] = {
            common.MAVLINK_MSG_ID_MISSION_COUNT: uploads.begin,
            common.MAVLINK_MSG_ID_MISSION_ITEM_INT: uploads.take_item,
            common.MAVLINK_MSG_ID_MISSION_ITEM: uploads.take_item,
            common.MAVLINK_MSG_ID_MISSION_REQUEST_LIST: downloads.tell_count,
            common.MAVLINK_MSG_ID_MISSION_REQUEST_INT: downloads.tell_item,
            common.MAVLINK_MSG_ID_MISSION_REQUEST: downloads.tell_item,
            common.MAVLINK_MSG_ID_MISSION_CLEAR_ALL: uploads.clear_for,
            common.MAVLINK_MSG_ID_MISSION_WRITE_PARTIAL_LIST: uploads.begin_part,
            common.MAVLINK_MSG_ID_MISSION_ACK: uploads.take_ack,
        }

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
                self.acknowledge(source(message), peer, common.MAV_MISSION_UNSUPPORTED, kind)

    def step(self, now_ns: int) -> None:
        """Answer what navigation has taken; ask for what has not come."""
        self._offers.step(now_ns)
        if not self._offers.are_pending:
            self._downloads.step(now_ns)
            self._uploads.step(now_ns)
        navigation = self._context.fresh_navigation(now_ns)
        if self._saved and navigation is not None and not self._offers.are_pending:
            self._offer_again(navigation, now_ns)

    # Clearing.

    def _clear_all_kinds(self, partner: Address, peer: Peer, now_ns: int) -> None:
        """Clear all plans, and answer once with the first refusal, else with ACCEPTED."""
        clears, results = self._context.clears, list[int]()

        def answer(result: int) -> None:
            results.append(result)
            if len(results) == len(clears):
                worst = next((each for each in results if each != ACCEPTED), ACCEPTED)
                self.acknowledge(partner, peer, worst, ALL)

        for clear in clears:
            clear(partner, answer, now_ns)

    def _offer_again(self, navigation: NavigationState, now_ns: int) -> None:
        """Offer the plan of before a power cut to a robot that has none."""
        content, self._saved = self._saved, b""
        plan = self.read(content)
        if not plan.content:
            return
        if plan.origin is not None and self._context.origin not in {None, plan.origin}:
            self.say(now_ns, "that of before is of another origin, left out")
            return
        self._context.origin = self._context.origin or plan.origin
        if self.is_taken(plan, navigation):
            self.adopt(plan, navigation)
        elif self.may_offer(navigation):
            self._offers.add(plan, [], [], now_ns)
