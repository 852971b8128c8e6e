"""Which ground stations are there, by their heartbeats."""

from __future__ import annotations

from dataclasses import dataclass

from pymavlink.dialects.v20 import common

from robotctl.mavlink.service import Context, source
from robotctl.messages.control import GroundStationPresence, Severity
from robotctl.messages.mavlink_port import Message, Peer

PRESENCE_NS = 200_000_000
"""So often navigation is told that a ground station is there, where it must be [ns]."""

MAX_STATIONS = 32
"""Whoever invents stations must not fill the memory."""


@dataclass(frozen=True, slots=True)
class GroundStation:
    """A ground station that is alive: its address, and when each link last heard it [ns]."""

    system_id: int
    component_id: int
    heard_ns: dict[int, int]

    @property
    def links(self) -> tuple[int, ...]:
        """The links on which it is heard."""
        return tuple(sorted(self.heard_ns))


class GroundStations:
    """Keeps those whose heartbeat is not older than `gcs_timeout_s`; says who comes and goes.

    Where the robot drives by itself only while one is there, navigation is told so again and again:
    it then sees by itself that the stations have gone, or that telemetry has.
    """

    handles = frozenset({common.MAVLINK_MSG_ID_HEARTBEAT})

    def __init__(self, context: Context) -> None:
        self._context = context
        self._timeout_ns = round(context.config.gcs_timeout_s * 1e9)
        self._told_ns = 0
        self._stations: dict[tuple[int, int], GroundStation] = {}

    @property
    def alive(self) -> tuple[GroundStation, ...]:
        """The stations that are heard, the longest known first."""
        return tuple(self._stations.values())

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Take one heartbeat; those of other vehicles and of onboard computers do not count."""
        if message.type != common.MAV_TYPE_GCS:
            return
        address = source(message)
        station = self._stations.get(address)
        if station is None:
            if len(self._stations) >= MAX_STATIONS:
                return
            station = GroundStation(*address, {})
            self._stations[address] = station
            self._context.say(now_ns, f"Ground station {address[0]} is here", Severity.INFORMATION)
        station.heard_ns[peer.link] = now_ns

    def step(self, now_ns: int) -> None:
        """Forget who is silent."""
        for address, station in list(self._stations.items()):
            for link, heard_ns in list(station.heard_ns.items()):
                if now_ns - heard_ns > self._timeout_ns:
                    del station.heard_ns[link]
            if not station.heard_ns:
                del self._stations[address]
                self._context.say(now_ns, f"Ground station {address[0]} is lost")
        needed = self._context.config.hold_without_gcs and self._stations
        if needed and now_ns - self._told_ns >= PRESENCE_NS:
            self._told_ns = now_ns
            self._context.requests.append(GroundStationPresence(now_ns))
