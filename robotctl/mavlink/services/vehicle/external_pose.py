"""VISION_POSITION_ESTIMATE and ODOMETRY to the robot: an externally measured pose.

| message | frame | pose |
|---|---|---|
| VISION_POSITION_ESTIMATE | local NED | x, y, yaw, covariance where given |
| ODOMETRY | LOCAL_NED, or LOCAL_FRD taken as such | x, y, yaw of q, pose_covariance where given |

The time of the sender is taken where it is our own monotonic clock, which TIMESYNC gives it: within
`OLDEST_NS` before now. Else the pose counts from its arrival. Other frames and poses that are no
numbers are refused and counted; what a localiser does with the rest is its own business.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import Final

from pymavlink.dialects.v20 import common

from robotctl.mavlink import frames
from robotctl.mavlink.context import Context
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import ExternalPose
from robotctl.messages.mavlink_port import Message, Peer

OLDEST_NS: Final = 1_000_000_000
"""Maximum age of a pose by its own stamp [ns]."""
_NED_FRAMES: Final = (common.MAV_FRAME_LOCAL_NED, common.MAV_FRAME_LOCAL_FRD)
_LARGEST_M: Final = 1.0e6
"""Greatest coordinate that is taken [m]: beyond, it is a mistake."""


class ExternalPoses(Microservice):
    """Turns poses of other systems into requests; `refused` counts by reason."""

    handles = frozenset(
        {common.MAVLINK_MSG_ID_VISION_POSITION_ESTIMATE, common.MAVLINK_MSG_ID_ODOMETRY}
    )

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self.refused: Counter[str] = Counter()

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:  # noqa: ARG002
        """Take one pose."""
        if message.get_msgId() == common.MAVLINK_MSG_ID_ODOMETRY:
            if message.frame_id not in _NED_FRAMES:
                self.refused["frame"] += 1
                return
            yaw = _yaw(message.q)
            stamp_us, covariance = message.time_usec, message.pose_covariance
        else:
            yaw, stamp_us, covariance = message.yaw, message.usec, message.covariance
        self._take(stamp_us * 1000, (message.x, message.y, yaw), covariance, now_ns)

    def _take(
        self,
        stamp_ns: int,
        pose: tuple[float, float, float],
        covariance: list[float],
        now_ns: int,
    ) -> None:
        """Hand on a pose in local NED."""
        north, east, yaw = pose
        if not (abs(north) < _LARGEST_M and abs(east) < _LARGEST_M and math.isfinite(yaw)):
            self.refused["not finite"] += 1
            return
        position = frames.enu_from_ned(north, east)
        if not now_ns - OLDEST_NS <= stamp_ns <= now_ns:
            stamp_ns = now_ns
        self._context.requests.append(
            ExternalPose(
                stamp_ns,
                position.x,
                position.y,
                frames.theta_from_yaw_ned(yaw),
                frames.pose_covariance_enu(covariance),
            )
        )


def _yaw(q: list[float]) -> float:
    """Return the yaw about z of a quaternion (w, x, y, z); nan if it is none."""
    w, x, y, z = q
    if not 0.5 < w * w + x * x + y * y + z * z < 2.0:
        return math.nan
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
