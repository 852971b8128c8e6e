"""Uploads of plans of one kind: one station at a time."""

from __future__ import annotations

from functools import partial
from typing import Final, Generic

from pymavlink.dialects.v20 import common

from robotctl.mavlink.context import Answer, Context
from robotctl.mavlink.missions.item import MissionItem, item_of
from robotctl.mavlink.missions.offers import ACCEPTED, DENIED, Offers
from robotctl.mavlink.missions.plan_service import P, PlanService
from robotctl.mavlink.missions.stations import Stations
from robotctl.mavlink.missions.translate import BadItem
from robotctl.mavlink.missions.upload import Upload
from robotctl.messages.mavlink_port import Address, Message, Peer, source

MOST_ITEMS: Final = 1000
GUIDED_ITEM: Final = 2
"""`current` of an item that is no part of a mission but a place to go to at once."""
_CANCELLED: Final[int] = common.MAV_MISSION_OPERATION_CANCELLED


class Uploads(Generic[P]):
    """The upload in progress, if there is one, and the answers to those that have ended.

    Parameters
    ----------
    context
        Links to the ground stations.
    service
        Kind of the plans, which checks items and answers.
    stations
        Memory of each station's transfers.
    offers
        Where a whole plan goes.
    """

    def __init__(
        self, context: Context, service: PlanService[P], stations: Stations, offers: Offers[P]
    ) -> None:
        self._context = context
        self._service = service
        self._stations = stations
        self._offers = offers
        self._upload: Upload | None = None

    def step(self, now_ns: int) -> None:
        """Ask for the item that has not come; give up an upload that stands still."""
        upload = self._upload
        if upload is not None:
            if upload.is_given_up(now_ns):
                self._service.say(now_ns, "the upload was given up, the old one stays")
                self._end(upload, _CANCELLED)
            elif upload.is_due(now_ns):
                upload.note_request(now_ns)
                self._request(upload)

    def begin(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Begin an upload, or restart it."""
        partner = source(message)
        if not self._yields(partner):
            self._service.acknowledge(partner, peer, DENIED)
        elif message.count > MOST_ITEMS:
            self._service.say(now_ns, f"{message.count} items, {MOST_ITEMS} allowed")
            self._service.acknowledge(partner, peer, common.MAV_MISSION_NO_SPACE)
        elif message.count == 0:
            self.clear_for(message, peer, now_ns)
        else:
            count = message.count + self._service.hidden
            self._upload = Upload(partner, peer, count, now_ns, self._service.hidden_items())

    def begin_part(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Begin to replace some items of the plan, which counts once it is checked as a whole.

        Not while navigation decides: the items that stay would be those of before.
        """
        hidden = self._service.hidden
        partner, items = source(message), self._service.listed(now_ns)
        first, last = message.start_index + hidden, message.end_index + hidden
        if self._offers.are_pending or not self._yields(partner):
            self._service.acknowledge(partner, peer, DENIED)
        elif not hidden <= first <= last < len(items):
            found = f"{message.start_index} to {message.end_index}"
            self._service.say(now_ns, f"no items {found} to replace")
            self._service.acknowledge(partner, peer, common.MAV_MISSION_INVALID_SEQUENCE)
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
        request = make(*upload.partner, upload.wanted - self._service.hidden, self._service.kind)
        self._context.links.reply(request, upload.peer)

    def take_item(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Take an item if it is the one that was requested."""
        partner, upload = source(message), self._upload
        if message.current >= GUIDED_ITEM:
            result = self._service.take_single(message, peer, now_ns)
            self._service.acknowledge(partner, peer, result)
        elif upload is None or upload.partner != partner:
            self._answer_stray(message, peer)
        elif message.seq + self._service.hidden != upload.wanted:
            upload.hurry()
        elif upload.has_requested:
            self._add(upload, item_of(message, self._service.hidden), now_ns)

    def _answer_stray(self, message: Message, peer: Peer) -> None:
        """Answer an item of a station that does not upload.

        Who repeats the last item of its upload has not heard the answer, and gets it again, once
        there is one; earlier ones are late copies.
        """
        partner = source(message)
        ended, seq = self._stations.ended(partner), message.seq + self._service.hidden
        if ended is None or seq > ended.seq:
            result = common.MAV_MISSION_ERROR if self._upload is None else DENIED
            self._service.acknowledge(partner, peer, result)
        elif seq == ended.seq and ended.result is not None:
            self._service.acknowledge(partner, peer, ended.result)

    def _add(self, upload: Upload, item: MissionItem, now_ns: int) -> None:
        """Add an item that is as it must be; offer the plan once it is whole."""
        try:
            self._service.check(item, upload.wanted)
            upload.take(item, now_ns)
            if not upload.is_complete:
                return
            plan, notes = self._service.read(b""), list[str]()
            if len(upload.whole) > self._service.first:
                plan, notes = self._service.plan_of(upload.whole)
        except BadItem as error:
            self._service.say(now_ns, f"item {error.seq - self._service.hidden}: {error.why}")
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
        self._service.acknowledge(upload.partner, upload.peer, result)

    def take_ack(self, message: Message, peer: Peer, now_ns: int) -> None:  # noqa: ARG002
        """End what a station reads, or with an error its upload, for which there is no answer."""
        partner, upload = source(message), self._upload
        self._stations.end_reading(partner)
        if message.type != ACCEPTED and upload is not None and upload.partner == partner:
            self._upload = None
            self._stations.end_upload(partner, upload.last, None)

    def clear_for(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Clear the plan for a station."""
        partner = source(message)
        self.clear(partner, partial(self._service.acknowledge, partner, peer), now_ns)

    def clear(self, partner: Address, answer: Answer, now_ns: int) -> None:
        """Ask navigation to drop its plan of this kind."""
        if self._yields(partner):
            self._offers.add(self._service.read(b""), [], [answer], now_ns)
        else:
            answer(DENIED)
