"""Tells wheel feedback of now from a frame that somebody's controller held back."""

from __future__ import annotations

import enum
from typing import Final

from robotctl.messages.control import WheelFeedback

TOLERANCE_NS: Final = 20_000_000
"""So much earlier or later than its latch may a frame come [ns]: it waits for the bus, and where
the drive is simulated, for a processor."""

GAP_NS: Final = 500_000_000
"""Half of what the drive's time stamp holds [ns]: behind a longer gap it may have rolled over."""

_STAMP_US: Final = 1 << 20
_HALF_US: Final = _STAMP_US >> 1


class Latch(enum.Enum):
    """What a frame is to the one before."""

    NEXT = "goes on from it"
    ANEW = "of a later time, but how much later is not known"
    HELD_BACK = "of another time: not to be used"


class LatchTimes:
    """Compares the way of the drive's time, from frame to frame, with that of the host's.

    A controller that recovers may send what it still has from long before, and the alive counter,
    of 15 values, lets one in five of such frames through; their counts are those of then. A frame
    whose time stamp contradicts the last one is not used. The next that goes on from it is: then
    the time between drive and host has changed for good.

    What it cannot see: a frame held back for the 1.048 s in which the time stamp rolls over, give
    or take `TOLERANCE_NS`.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all, as after a restart of the drive."""
        self._last: WheelFeedback | None = None
        self._odd: WheelFeedback | None = None

    def judge(self, wheels: WheelFeedback) -> Latch:
        """Return what a frame is, and take it for the last unless it was held back."""
        last, odd = self._last, self._odd
        if last is None or _goes_on(wheels, last):
            latch = Latch.NEXT
        elif wheels.stamp_ns - last.stamp_ns > GAP_NS or (
            odd is not None and _goes_on(wheels, odd)
        ):
            latch = Latch.ANEW
        else:
            self._odd = wheels
            return Latch.HELD_BACK
        self._last, self._odd = wheels, None
        return latch


def _goes_on(wheels: WheelFeedback, before: WheelFeedback) -> bool:
    """Return whether as much time has passed for the drive as for the host, and no gap."""
    host_ns = wheels.stamp_ns - before.stamp_ns
    if host_ns > GAP_NS:
        return False
    late_us = host_ns // 1000 - (wheels.timestamp_us - before.timestamp_us)
    late_us = (late_us + _HALF_US) % _STAMP_US - _HALF_US
    return abs(late_us) * 1000 <= TOLERANCE_NS
