"""ESTIMATOR_STATUS: how well the robot knows where it is; to who asks for it."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import common

from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.frames import boot_us
from robotctl.mavlink.service import Microservice
from robotctl.messages.mavlink_port import Message

_MOTION = (
    common.ESTIMATOR_ATTITUDE | common.ESTIMATOR_VELOCITY_HORIZ | common.ESTIMATOR_POS_HORIZ_REL
)


class Estimator(Microservice):
    """Sends flags and accuracy while control publishes."""

    def streams(self) -> tuple[Stream, ...]:
        """Return the message, off until somebody asks for it."""
        return (Stream(common.MAVLINK_MSG_ID_ESTIMATOR_STATUS, self._build, 0.0),)

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
