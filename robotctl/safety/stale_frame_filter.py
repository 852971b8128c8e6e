"""Tells present wheel feedback from a frame that a CAN controller delayed."""

from __future__ import annotations

import enum
from typing import Final

from robotctl.messages.actuators import ActuatorFeedback

TOLERANCE_NS: Final = 20_000_000
"""Tolerance of a frame's arrival against its latch [ns]: it waits for the bus and, in simulation,
for a CPU."""

GAP_NS: Final = 500_000_000
"""Half the range of the drive's time stamp [ns]: after a longer gap it may have rolled over."""

_STAMP_US: Final = 1 << 20
_HALF_US: Final = _STAMP_US >> 1


class Latch(enum.Enum):
    """Relation of a frame to the previous one."""

    NEXT = "goes on from it"
    ANEW = "of a later time, but how much later is not known"
    HELD_BACK = "of another time: not to be used"


_NEXT: Final = Latch.NEXT
"""Looking up a member of an enumeration is slow."""


class LatchTimes:
    """Compares the drive's elapsed time, from frame to frame, with the host's.

    A recovering controller may send old frames, and the alive counter, with 15 values, accepts one
    in five of them; their counts are out of date. A frame whose time stamp contradicts the last one
    is not used. A next frame consistent with it is: then the offset between drive and host has
    changed for good.

    Undetectable: a frame delayed by 1.048 s, the roll-over of the time stamp, give or take
    `TOLERANCE_NS`.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Reset, as after a restart of the drive."""
        self._last: ActuatorFeedback | None = None
        self._odd: ActuatorFeedback | None = None

    def judge(self, wheel: ActuatorFeedback) -> Latch:
        """Return the relation of a frame, and remember it unless it was delayed."""
        last, odd = self._last, self._odd
        if last is None or _goes_on(wheel, last):
            latch = _NEXT
        elif wheel.motion_ns - last.motion_ns > GAP_NS or (
            odd is not None and _goes_on(wheel, odd)
        ):
            latch = Latch.ANEW
        else:
            self._odd = wheel
            return Latch.HELD_BACK
        self._last, self._odd = wheel, None
        return latch


def _goes_on(wheel: ActuatorFeedback, before: ActuatorFeedback) -> bool:
    """Return whether as much time has passed for the drive as for the host, and no gap."""
    host_ns = wheel.motion_ns - before.motion_ns
    if host_ns > GAP_NS:
        return False
    late_us = host_ns // 1000 - (wheel.latch_us - before.latch_us)
    late_us = (late_us + _HALF_US) % _STAMP_US - _HALF_US
    return abs(late_us) * 1000 <= TOLERANCE_NS
