"""Presence of ground stations, by their heartbeats."""

from __future__ import annotations

from pymavlink.dialects.v20 import common

from robotctl.mavlink.context import Context, GroundStation
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import GroundStationPresence, Severity
from robotctl.messages.mavlink_port import Message, Peer, source

PRESENCE_NS = 200_000_000
"""Period of reporting to navigation that a ground station is connected [ns]."""

SETTLE_NS = 1_000_000_000
"""Time after the loss of the operator's station for which the loss of others does not count, so
that navigation hears of it [ns]."""

MAX_STATIONS = 32
"""Invented stations must not fill the memory."""


class GroundStations(Microservice):
    """Keeps stations with a heartbeat within `gcs_timeout_s`; reports arrivals and losses.

    Where their loss stops a robot that drives by itself, navigation is told again and again that
    they are there: it then sees by itself that they have gone, or that telemetry has. The loss that
    counts is that of the operator's station, `gcs_system_id`, or of the last one before that was
    heard.
    """

    handles = frozenset({common.MAVLINK_MSG_ID_HEARTBEAT})

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._timeout_ns = round(context.config.gcs_timeout_s * 1e9)
        self._told_ns = 0
        self._operator_ns: int | None = None
        """Last heartbeat of the operator's station [ns]."""

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Take one heartbeat; those of other vehicles and of onboard computers do not count."""
        address, stations = source(message), self._context.ground_stations
        self._context.held_back.hear(peer, address, now_ns)
        if message.type != common.MAV_TYPE_GCS:
            return
        station = stations.get(address)
        if station is None:
            if len(stations) >= MAX_STATIONS:
                return
            station = GroundStation(*address, {})
            stations[address] = station
            self._context.say(
                now_ns, f"Ground station {address[0]} connected", Severity.INFORMATION
            )
        station.heard_ns[peer.link] = now_ns
        if address[0] == self._context.config.gcs_system_id:
            self._operator_ns = now_ns

    def step(self, now_ns: int) -> None:
        """Drop silent stations."""
        stations = self._context.ground_stations
        for address, station in list(stations.items()):
            for link, heard_ns in list(station.heard_ns.items()):
                if now_ns - heard_ns > self._timeout_ns:
                    del station.heard_ns[link]
            if not station.heard_ns:
                del stations[address]
                self._context.say(now_ns, f"Ground station {address[0]} is lost")
        config = self._context.config
        matters = config.hold_without_gcs or config.hold_on_gcs_loss
        if matters and stations and now_ns - self._told_ns >= PRESENCE_NS:
            self._told_ns = now_ns
            heard_ns = self._watched_ns(now_ns)
            self._context.requests.append(GroundStationPresence(now_ns, heard_ns))

    def _watched_ns(self, now_ns: int) -> int:
        """Return the last heartbeat of the station whose loss counts [ns]."""
        last_ns = self._operator_ns
        if last_ns is not None and now_ns - last_ns <= self._timeout_ns + SETTLE_NS:
            return last_ns
        self._operator_ns = None
        stations = self._context.ground_stations.values()
        return max(max(station.heard_ns.values()) for station in stations)
