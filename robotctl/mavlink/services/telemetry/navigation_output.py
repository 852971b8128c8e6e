"""NAV_CONTROLLER_OUTPUT: which way, and how far, the place is that the robot drives to."""

from __future__ import annotations

import math
from typing import Final

from pymavlink.dialects.v20 import common

from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.frames import UINT16_MAX, yaw_ned_from_theta
from robotctl.mavlink.service import Microservice
from robotctl.messages.mavlink_port import Message

RATE_HZ: Final = 2.0
"""Rate of the message [Hz]."""


class NavigationOutput(Microservice):
    """Sends bearing and distance while the robot drives to a place."""

    def streams(self) -> tuple[Stream, ...]:
        """Return the message."""
        group = common.MAV_DATA_STREAM_EXTENDED_STATUS
        return (Stream(common.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT, self._build, RATE_HZ, group),)

    def _build(self, now_ns: int) -> list[Message]:
        """Return the straight line to the place: bearing [deg] and distance [m]."""
        context = self._context
        navigation, pose = context.fresh_navigation(now_ns), context.known_pose(now_ns)
        if navigation is None or navigation.goal is None or pose is None:
            return []
        x_m, y_m = navigation.goal[0] - pose.x_m, navigation.goal[1] - pose.y_m
        bearing_deg = round(math.degrees(yaw_ned_from_theta(math.atan2(y_m, x_m))))
        distance_m = min(round(math.hypot(x_m, y_m)), UINT16_MAX)
        return [
            common.MAVLink_nav_controller_output_message(
                0.0, 0.0, bearing_deg, bearing_deg, distance_m, 0.0, 0.0, 0.0
            )
        ]
