"""A drive's clock against the host's."""

from __future__ import annotations

from typing import Final

from robotctl.messages.actuators import ActuatorFeedback
from robotctl.messages.faults import Fault, FaultCode

WINDOW_NS: Final = 2_000_000_000
"""Length of a comparison [ns]."""

_GAP_NS: Final = 500_000_000
_STAMP_US: Final = (1 << 20) - 1


class ClockMonitor:
    """Compares the time between positions by the drive's clock with that by the host's.

    Parameters
    ----------
    drive
        Name of the drive.
    clock_share
        By how much its clock may be faster or slower.
    """

    def __init__(self, drive: str, clock_share: float) -> None:
        self._drive = drive
        self._share = clock_share
        self.reset()

    def reset(self) -> None:
        """Start over."""
        self._latch_us, self._host_ns = -1, 0
        self._drive_us = self._elapsed_ns = 0

    def update(self, wheel: ActuatorFeedback) -> Fault | None:
        """Take a position with its time; return a fault if the clocks run apart."""
        latch_us, stamp_ns = wheel.latch_us, wheel.motion_ns
        host_ns, before_us = stamp_ns - self._host_ns, self._latch_us
        self._latch_us, self._host_ns = latch_us, stamp_ns
        if before_us < 0 or host_ns > _GAP_NS:
            self._drive_us = self._elapsed_ns = 0
            return None
        self._drive_us += (latch_us - before_us) & _STAMP_US
        self._elapsed_ns += host_ns
        if self._elapsed_ns < WINDOW_NS:
            return None
        excess = self._drive_us * 1000.0 / self._elapsed_ns - 1.0
        self._drive_us = self._elapsed_ns = 0
        if abs(excess) <= self._share:
            return None
        text = f"the drive's clock runs {excess:+.1%} against the host's"
        return Fault(FaultCode.CLOCK_DRIFT, text, self._drive)
