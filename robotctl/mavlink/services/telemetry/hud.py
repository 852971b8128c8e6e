"""VFR_HUD and EXTENDED_SYS_STATE: what the instruments of ground stations show of a rover."""

from __future__ import annotations

import math
from typing import Final

from pymavlink.dialects.v20 import common

from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.frames import fit, yaw_ned_from_theta
from robotctl.mavlink.service import Microservice
from robotctl.messages.mavlink_port import Message

HUD_HZ: Final = 2.0
STATE_HZ: Final = 1.0
"""Rates of VFR_HUD and of EXTENDED_SYS_STATE [Hz]."""


class Hud(Microservice):
    """Sends speed, heading and power, and that the robot is on the ground."""

    def streams(self) -> tuple[Stream, ...]:
        """Return both messages."""
        return (
            Stream(common.MAVLINK_MSG_ID_VFR_HUD, self._hud, HUD_HZ, common.MAV_DATA_STREAM_EXTRA2),
            Stream(common.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, self._state, STATE_HZ),
        )

    def _hud(self, now_ns: int) -> list[Message]:
        """Return VFR_HUD: speed over ground [m/s], heading [deg], mean power of the motors [%].

        There is no speed of air; as an ArduPilot rover it sends that of the ground in its place,
        which stations show. Altitude is that of the map's origin [m].
        """
        context = self._context
        control, pose = context.fresh_control(now_ns), context.known_pose(now_ns)
        if control is None or pose is None or not fit(control.v_m_s, pose.theta_rad):
            return []
        powers = [min(abs(each), 1.0) for each in control.duty if math.isfinite(each)]
        percent = round(100.0 * sum(powers) / len(powers)) if powers else 0
        heading_deg = round(math.degrees(yaw_ned_from_theta(pose.theta_rad))) % 360
        speed_m_s = abs(control.v_m_s)
        altitude_m = 0.0 if context.origin is None else context.origin.altitude_m
        return [
            common.MAVLink_vfr_hud_message(
                math.nan if math.isnan(context.personality.unused) else speed_m_s,
                speed_m_s,
                heading_deg,
                percent,
                altitude_m,
                0.0,
            )
        ]

    def _state(self, now_ns: int) -> list[Message]:
        """Return EXTENDED_SYS_STATE."""
        if self._context.fresh_control(now_ns) is None:
            return []
        return [
            common.MAVLink_extended_sys_state_message(
                common.MAV_VTOL_STATE_UNDEFINED, common.MAV_LANDED_STATE_ON_GROUND
            )
        ]
