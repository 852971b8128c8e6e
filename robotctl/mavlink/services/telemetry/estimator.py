"""ESTIMATOR_STATUS and EKF_STATUS_REPORT: how well the robot knows where it is; on request.

The second is ArduPilot's; dronekit's `is_armable` waits for its EKF_PRED_POS_HORIZ_ABS.
"""

from __future__ import annotations

import math
from typing import Final

from pymavlink.dialects.v20 import common

from robotctl.dialect import additions
from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.frames import boot_us
from robotctl.mavlink.service import Microservice
from robotctl.messages.mavlink_port import Message

_MOTION = (
    common.ESTIMATOR_ATTITUDE | common.ESTIMATOR_VELOCITY_HORIZ | common.ESTIMATOR_POS_HORIZ_REL
)


_EKF_MOTION: Final = 1 | 2 | 8 | 256
"""EKF_ATTITUDE, _VELOCITY_HORIZ, _POS_HORIZ_REL and _PRED_POS_HORIZ_REL of EKF_STATUS_FLAGS."""
_EKF_PLACE: Final = 16 | 512
"""EKF_POS_HORIZ_ABS and _PRED_POS_HORIZ_ABS."""


class Estimator(Microservice):
    """Sends flags and accuracy while control publishes."""

    def streams(self) -> tuple[Stream, ...]:
        """Return both messages; a station has to ask for them."""
        report = additions.MAVLINK_MSG_ID_EKF_STATUS_REPORT
        return (
            Stream(common.MAVLINK_MSG_ID_ESTIMATOR_STATUS, self._build, 0.0),
            Stream(report, self._report, 0.0, common.MAV_DATA_STREAM_EXTRA3),
        )

    def _build(self, now_ns: int) -> list[Message]:
        """Return the flags of what is known, and one standard deviation of the place [m].

        Odometry alone has no place on a map: its position is a relative one. Ratios of
        innovations to their gates are not known.
        """
        context = self._context
        control, fix = context.fresh_control(now_ns), context.fresh_fix(now_ns)
        if control is None:
            return []
        flags = _MOTION if math.isfinite(control.v_m_s) else common.ESTIMATOR_ATTITUDE
        accuracy_m = math.nan
        if fix is not None:
            flags |= common.ESTIMATOR_POS_HORIZ_ABS | common.ESTIMATOR_PRED_POS_HORIZ_ABS
            xx, _, _, yy, *_ = fix.covariance
            accuracy_m = math.sqrt(max(xx + yy, 0.0))
        return [
            common.MAVLink_estimator_status_message(
                boot_us(control.stamp_ns), flags, *[math.nan] * 6, accuracy_m, math.nan
            )
        ]

    def _report(self, now_ns: int) -> list[Message]:
        """Return the flags of what is known; the ratios, which are not, are 0.

        The place is that in `world` which GLOBAL_POSITION_INT tells, also by odometry alone.
        """
        context = self._context
        control = context.fresh_control(now_ns)
        if control is None:
            return []
        flags = _EKF_MOTION if math.isfinite(control.v_m_s) else 1
        flags |= _EKF_PLACE if context.known_pose(now_ns) is not None else 0
        return [additions.MAVLink_ekf_status_report_message(flags, *[0.0] * 5)]
