"""The robot on the globe, once a ground station has said where the origin of `world` is."""

from __future__ import annotations

import math
from typing import Final

from pymavlink.dialects.v20 import common

from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.frames import (
    UINT32_MAX,
    boot_ms,
    ned_from_enu,
    quaternion_from_yaw_ned,
    velocity_ned,
    yaw_ned_from_theta,
)
from robotctl.mavlink.globe import SCALE, Origin
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import Severity
from robotctl.messages.mavlink_port import Message, Peer
from robotctl.messages.requests import FARTHEST_M
from robotctl.safety.state_machine import POWERED

RATE_HZ: Final = 2.0
GPS_HZ: Final = 1.0
_UNKNOWN: Final = 0xFFFF
_SATELLITES: Final = 255
"""Number of satellites: unknown."""
_FASTEST_M_S: Final = 300.0
"""Maximum speed that fits the message [m/s]."""
_MILLI: Final = 1e3
_CENTI: Final = 1e2
"""Units per metre, and per metre a second, of GLOBAL_POSITION_INT."""


class GlobalPosition(Microservice):
    """Takes SET_GPS_GLOBAL_ORIGIN; sends where origin, robot and home are on the globe."""

    handles = frozenset({common.MAVLINK_MSG_ID_SET_GPS_GLOBAL_ORIGIN})

    def streams(self) -> tuple[Stream, ...]:
        """Return the position at 2 Hz, GPS_RAW_INT at 1 Hz, and origin and home on request."""
        return (
            Stream(
                common.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
                self._position,
                RATE_HZ,
                common.MAV_DATA_STREAM_POSITION,
            ),
            Stream(
                common.MAVLINK_MSG_ID_GPS_RAW_INT,
                self._gps,
                GPS_HZ,
                common.MAV_DATA_STREAM_EXTENDED_STATUS,
            ),
            Stream(common.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, self._origin, 0.0),
            Stream(common.MAVLINK_MSG_ID_HOME_POSITION, self._home, 0.0),
        )

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:  # noqa: ARG002
        """Take the origin and tell all.

        Not while armed, nor while the mission has places by another one: they would mean others.
        """
        context = self._context
        control = context.fresh_control(now_ns)
        if control is not None and control.state in POWERED:
            context.say(now_ns, "Origin: not while armed")
            return
        try:
            origin = Origin(
                message.latitude / SCALE, message.longitude / SCALE, message.altitude / _MILLI
            )
        except ValueError as error:
            context.say(now_ns, f"Origin: {error}")
            return
        if origin != context.origin:
            if context.origin_users:
                users = " and ".join(sorted(context.origin_users))
                context.say(now_ns, f"Origin: clear the {users} first, its places are by another")
                return
            context.origin = origin
            where = f"{origin.latitude_deg:.7f}, {origin.longitude_deg:.7f}"
            context.say(now_ns, f"Origin of the map at {where}", Severity.NOTICE)
        for answer in (*self._origin(now_ns), *self._home(now_ns)):
            context.links.broadcast(answer)

    def _position(self, now_ns: int) -> list[Message]:
        """Return GLOBAL_POSITION_INT: mm, cm/s, and the heading in cdeg."""
        origin, found = self._context.origin, self._context.fresh_pose(now_ns)
        if origin is None or found is None or self._context.known_pose(now_ns) is None:
            return []
        control, pose = found
        if not (
            abs(control.v_m_s) < _FASTEST_M_S and max(abs(pose.x_m), abs(pose.y_m)) < FARTHEST_M
        ):
            return []
        latitude_deg, longitude_deg = origin.from_world(pose.x_m, pose.y_m)
        velocity = velocity_ned(control.v_m_s, pose.theta_rad)
        heading_deg = math.degrees(yaw_ned_from_theta(pose.theta_rad)) % 360.0
        return [
            common.MAVLink_global_position_int_message(
                boot_ms(control.stamp_ns),
                round(latitude_deg * SCALE),
                round(longitude_deg * SCALE),
                round(origin.altitude_m * _MILLI),
                0,
                round(velocity.north * _CENTI),
                round(velocity.east * _CENTI),
                0,
                round(heading_deg * _CENTI) % 36_000,
            )
        ]

    def _gps(self, now_ns: int) -> list[Message]:
        """Return GPS_RAW_INT: the place by the map as a fix, since stations wait for one.

        There is no GPS, and so no satellite. No fix while the place is not known.
        """
        if self._context.origin is None or self._context.fresh_control(now_ns) is None:
            return []
        fix, place, accuracy_mm = common.GPS_FIX_TYPE_NO_FIX, (0, 0, 0), 0
        for position in self._position(now_ns):
            fix, place = common.GPS_FIX_TYPE_3D_FIX, (position.lat, position.lon, position.alt)
            accuracy_mm = self._accuracy_mm(now_ns)
        return [
            common.MAVLink_gps_raw_int_message(
                now_ns // 1000, fix, *place, *[_UNKNOWN] * 4, _SATELLITES, 0, accuracy_mm
            )
        ]

    def _accuracy_mm(self, now_ns: int) -> int:
        """Return one standard deviation of the place [mm]; 0: it is not known."""
        fix = self._context.fresh_fix(now_ns)
        if fix is None:
            return 0
        xx, _, _, yy, *_ = fix.covariance
        return min(round(math.sqrt(max(xx + yy, 0.0)) * _MILLI), UINT32_MAX)

    def _origin(self, now_ns: int) -> list[Message]:  # noqa: ARG002
        origin = self._context.origin
        if origin is None:
            return []
        place = _place(origin.latitude_deg, origin.longitude_deg)
        return [common.MAVLink_gps_global_origin_message(*place, round(origin.altitude_m * _MILLI))]

    def _home(self, now_ns: int) -> list[Message]:  # noqa: ARG002
        """Return HOME_POSITION: where RTL leads to."""
        origin, home = self._context.origin, self._context.home
        if origin is None:
            return []
        north, east = ned_from_enu(home.x_m, home.y_m)
        return [
            common.MAVLink_home_position_message(
                *_place(*origin.from_world(home.x_m, home.y_m)),
                round(origin.altitude_m * _MILLI),
                north,
                east,
                0.0,
                quaternion_from_yaw_ned(yaw_ned_from_theta(home.theta_rad)),
                *[self._context.personality.unused] * 3,  # the approach
            )
        ]


def _place(latitude_deg: float, longitude_deg: float) -> tuple[int, int]:
    return round(latitude_deg * SCALE), round(longitude_deg * SCALE)
