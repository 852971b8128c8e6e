"""Downloads of plans of one kind: each station reads the plan that it began with."""

from __future__ import annotations

from typing import Generic

from pymavlink.dialects.v20 import common

from robotctl.mavlink.context import Context
from robotctl.mavlink.missions.item import message_of
from robotctl.mavlink.missions.offers import Offers
from robotctl.mavlink.missions.plan_service import P, PlanService
from robotctl.mavlink.missions.stations import MOST_STATIONS, Stations
from robotctl.messages.mavlink_port import Address, Message, Peer, source


class Downloads(Generic[P]):
    """Stations that read the plan, or wait to.

    Parameters
    ----------
    context
        Links to the ground stations.
    service
        Kind of the plans, and the present one.
    stations
        Memory of each station's transfers.
    offers
        Plans that navigation has still to decide on.
    """

    def __init__(
        self, context: Context, service: PlanService[P], stations: Stations, offers: Offers[P]
    ) -> None:
        self._context = context
        self._service = service
        self._stations = stations
        self._offers = offers
        self._listing: dict[Address, Peer] = {}
        """Stations that asked for the list while navigation decides."""

    def step(self, now_ns: int) -> None:
        """Answer those who asked while navigation decided."""
        for partner, peer in self._listing.items():
            self._count(partner, peer, now_ns)
        self._listing.clear()

    def tell_count(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Say how many items there are, once navigation has decided on what came before."""
        partner = source(message)
        if not self._offers.are_pending:
            self._count(partner, peer, now_ns)
        elif len(self._listing) < MOST_STATIONS:
            self._listing[partner] = peer

    def _count(self, partner: Address, peer: Peer, now_ns: int) -> None:
        """Say how many items there are; the station then reads them whatever comes meanwhile."""
        items = self._service.listed(now_ns)
        self._stations.begin_reading(partner, items, now_ns)
        count = max(len(items) - self._service.hidden, 0)
        self._context.links.reply(
            common.MAVLink_mission_count_message(*partner, count, self._service.kind), peer
        )

    def tell_item(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Send one item in the form in which it is asked for."""
        service, partner = self._service, source(message)
        seq = message.seq + service.hidden
        items = self._stations.reads(partner, now_ns) or service.listed(now_ns) or service.always()
        if not seq < len(items):
            service.acknowledge(partner, peer, common.MAV_MISSION_INVALID_SEQUENCE)
            return
        whole = message.get_msgId() == common.MAVLINK_MSG_ID_MISSION_REQUEST_INT
        current = seq == service.seq(now_ns)
        answer = message_of(
            items[seq],
            seq,
            partner,
            current=current,
            whole=whole,
            kind=service.kind,
            hidden=service.hidden,
        )
        self._context.links.reply(answer, peer)
