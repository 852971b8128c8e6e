"""Whether a ground station watches the robot, and when one is lost."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from robotctl.messages.control import GroundStationPresence, NavigationRequest

PRESENCE_MAX_AGE_NS: Final = 1_000_000_000
"""Time without a report from telemetry after which there is no ground station [ns]."""


class StationWatch:
    """Follows the ground stations by what telemetry reports of them.

    Parameters
    ----------
    needs_station
        Whether the robot drives by itself only while a ground station is there.
    timeout_s
        Silence of a ground station that was there after which it is lost [s]; inf: never.
    """

    def __init__(self, *, needs_station: bool, timeout_s: float) -> None:
        self._needs_station = needs_station
        self._timeout_s = timeout_s
        self._present_ns: int | None = None
        """When a ground station was there last [ns]; None: never."""
        self._watched_ns = 0
        """Last heartbeat of the station that is watched [ns]; 0: there is none."""
        self._lost_ns = 0
        """Last heartbeat of the station that was lost [ns]; 0: none was."""

    def note(self, requests: Iterable[NavigationRequest]) -> None:
        """Take the reports among the requests of a step."""
        for each in requests:
            if isinstance(each, GroundStationPresence):
                self._present_ns, self._watched_ns = each.stamp_ns, each.heard_ns

    def attends(self, now_ns: int) -> bool:
        """Return whether a ground station is there, or need not be."""
        if not self._needs_station:
            return True
        present_ns = self._present_ns
        return present_ns is not None and now_ns - present_ns <= PRESENCE_MAX_AGE_NS

    def loses(self, now_ns: int) -> bool:
        """Return whether a ground station that was there is lost now; once for each."""
        silent_s = (now_ns - self._watched_ns) * 1e-9
        if self._watched_ns in (0, self._lost_ns) or silent_s <= self._timeout_s:
            return False
        self._lost_ns = self._watched_ns
        return True
