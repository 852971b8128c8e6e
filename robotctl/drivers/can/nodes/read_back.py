"""Readings of the settings of a node in service: one of them after another, again and again."""

from __future__ import annotations

from typing import Final

from robotctl.drivers.can.nodes.commissioning import Setting, no_answer
from robotctl.drivers.can.nodes.sdo import Request, SdoResponse
from robotctl.messages.faults import Fault, FaultCode

UNREAD_MAX: Final = 5
"""Consecutive readings of a setting that may fail: another tool may use the node's SDO channel."""

QUIET_NS: Final = 500_000_000
"""Time after another tool's request without readings: both would get both answers [ns]."""

QUIET_MAX_NS: Final = 1_000_000_000
"""Maximum time that a tool's continuous requests keep the robot from reading [ns]."""


class ReadBack:
    """Compares the settings of a node with what they must be.

    Attributes
    ----------
    is_reading
        Whether an answer is awaited.
    """

    __slots__ = ("_doubted", "_kept", "_quiet_ns", "_read_ns", "_unread", "is_reading")

    def __init__(self) -> None:
        self.is_reading = False
        self._kept: tuple[Setting, ...] = ()
        """Settings to read back; the first is next."""
        self._doubted = False
        """Whether the last reading differed: a single one may be a damaged answer."""
        self._unread = 0
        self._read_ns = self._quiet_ns = 0
        """When a setting was read last; until when the SDO channel is left to others [ns]."""

    def begin(self, kept: tuple[Setting, ...]) -> None:
        """Take the settings that must stay as they are."""
        self._kept = kept
        self._doubted = False
        self._unread = 0

    def give_way(self, stamp_ns: int) -> None:
        """Leave the node's single SDO channel for a while to another tool's request [ns]."""
        self._quiet_ns = stamp_ns + QUIET_NS

    def next(self, now_ns: int) -> Request | None:
        """Return the reading to start now, if the channel is not left to others."""
        # Continuous requests of a tool must not keep settings from being checked for ever.
        if now_ns < self._quiet_ns and now_ns - self._read_ns < QUIET_MAX_NS:
            return None
        if not self._kept:
            return None
        self._read_ns = now_ns
        self.is_reading = True
        return self._kept[0].reading

    def take(self, response: SdoResponse) -> Fault | Request | None:
        """Return what an answer proves wrong, or the reading to repeat at once, or None."""
        self.is_reading = False
        setting = self._kept[0]
        # No answer is no proof of a change: only several in a row count.
        if response.value is None:
            self._unread += 1
            return no_answer(setting.reading) if self._unread > UNREAD_MAX else None
        self._unread = 0
        if response.value == setting.wanted:
            self._doubted = False
            self._kept = (*self._kept[1:], setting)
            return None
        if self._doubted:
            text = f"{setting.differs(response.value)}: it was changed"
            return Fault(FaultCode.NODE_CHANGED, text)
        self._doubted = self.is_reading = True
        return setting.reading
