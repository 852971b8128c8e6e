"""The motion of one wheel, from what its drive reports to an estimator."""

from __future__ import annotations

from typing import Final

import msgspec

from robotctl.control.wheels import VelocityEstimator
from robotctl.messages.actuators import ActuatorFeedback
from robotctl.safety.stale_frame_filter import Latch, LatchTimes

_NOTHING: Final = ActuatorFeedback()
_NEXT: Final = Latch.NEXT
_HELD_BACK: Final = Latch.HELD_BACK
_ANEW: Final = Latch.ANEW
"""Looking up a member of an enumeration is slow."""
_STAMP_US: Final = (1 << 20) - 1
"""Time stamps of positions roll over beyond this [us], whoever gives them."""


class WheelMotion:
    """Feeds the estimator of a wheel, without reports of another time.

    Parameters
    ----------
    estimator
        That of the wheel's loop.
    """

    def __init__(self, estimator: VelocityEstimator) -> None:
        self._estimator = estimator
        self._latches = LatchTimes()
        self._used = _NOTHING
        """The newest report that was used."""
        self._seen_ns = _NOTHING.motion_ns
        """Reception of the newest one [ns]."""
        self._has_begun = False

    def restart(self) -> None:
        """Start over with the next position: the drive's count has restarted."""
        self._latches.reset()
        self._has_begun = False

    def take(self, report: ActuatorFeedback) -> tuple[ActuatorFeedback, bool]:
        """Take the newest report; return it without a motion of another time, and whether it moved.

        A motion that was refused is replaced by that of the last report used.
        """
        if report.motion_ns != self._seen_ns:
            self._seen_ns = report.motion_ns
            if self._use(report):
                return report, True
        used = self._used
        if report.motion_ns == used.motion_ns:
            return report, False
        return msgspec.structs.replace(
            report,
            motion_ns=used.motion_ns,
            latch_us=used.latch_us,
            position_ticks=used.position_ticks,
            speed_rad_s=used.speed_rad_s,
        ), False

    def _use(self, report: ActuatorFeedback) -> bool:
        """Update the estimator; return whether the report was of its time."""
        stamp_us, latch = report.latch_us, _NEXT
        if stamp_us >= 0:
            latch = self._latches.judge(report)
            if latch is _HELD_BACK:
                return False
        else:
            stamp_us = report.motion_ns // 1000 & _STAMP_US
        estimator, ticks = self._estimator, report.position_ticks
        if not self._has_begun:
            estimator.reset(ticks, stamp_us)
        elif latch is _ANEW:
            estimator.resume(ticks, stamp_us)
        self._has_begun = True
        self._used = report
        estimator.update(ticks, stamp_us, report.speed_rad_s)
        return True
