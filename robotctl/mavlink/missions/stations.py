"""Memory of each ground station's transfers of one kind of plans."""

from __future__ import annotations

from typing import Final, NamedTuple, TypeVar

from robotctl.mavlink.missions.item import MissionItem
from robotctl.messages.mavlink_port import Address

MOST_STATIONS: Final = 32
"""Invented stations must not fill the memory."""
READING_NS: Final = 5_000_000_000
"""Time after its last request at which a download ends [ns]."""

T = TypeVar("T")


class Ended(NamedTuple):
    """A station's last upload."""

    seq: int
    """Number of its last item that was taken or requested."""
    result: int | None
    """MAV_MISSION_RESULT; None: not decided, or the station has ended it."""


class _Reading(NamedTuple):
    """A download."""

    items: tuple[MissionItem, ...]
    requested_ns: int


class Stations:
    """How each station's last upload ended, and what it is reading.

    The plan may change during a download; the station reads the one that it began with.
    """

    def __init__(self) -> None:
        self._ended: dict[Address, Ended] = {}
        self._readings: dict[Address, _Reading] = {}

    def ended(self, station: Address) -> Ended | None:
        """Return how a station's last upload ended; None: it has begun none, or another one."""
        return self._ended.get(station)

    def end_upload(self, station: Address, seq: int, result: int | None) -> None:
        """Note how a station's upload ended, by the number of its last item."""
        _remember(self._ended, station, Ended(seq, result))

    def begin_upload(self, station: Address) -> None:
        """Forget a station's transfers of before."""
        self._ended.pop(station, None)
        self._readings.pop(station, None)

    def begin_reading(self, station: Address, items: tuple[MissionItem, ...], now_ns: int) -> None:
        """Note what a station begins to read."""
        _remember(self._readings, station, _Reading(items, now_ns))

    def end_reading(self, station: Address) -> None:
        """Note that a station has read all, or reads no more."""
        self._readings.pop(station, None)

    def reads(self, station: Address, now_ns: int) -> tuple[MissionItem, ...]:
        """Return what a station is reading, and note a request for it; (): nothing."""
        reading = self._readings.pop(station, None)
        if reading is None or now_ns - reading.requested_ns > READING_NS:
            return ()
        self._readings[station] = reading._replace(requested_ns=now_ns)
        return reading.items


def _remember(table: dict[Address, T], station: Address, value: T) -> None:
    """Note a station's value; the longest unchanged ones go where there are too many."""
    table.pop(station, None)
    table[station] = value
    if len(table) > MOST_STATIONS:
        del table[next(iter(table))]
