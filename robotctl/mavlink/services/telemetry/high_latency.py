"""HIGH_LATENCY2: all that matters in one small message, for satellite links and the like."""

from __future__ import annotations

import math
from typing import Final

from pymavlink.dialects.v20 import common

from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.context import Context
from robotctl.mavlink.frames import boot_ms, fit, percent, yaw_ned_from_theta
from robotctl.mavlink.globe import SCALE
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import ControlState, NavigationState, SafetyState
from robotctl.messages.mavlink_port import Message
from robotctl.model.geometry.se2 import SE2

_UINT8: Final = 255
_FIFTHS: Final = 5.0
"""Units of speed per metre per second: fifths."""
_DECAMETRE: Final = 10.0
_MOST_ALTITUDE_M: Final = 32_767
"""Unit of distance [m], and greatest altitude that the message carries [m]."""


class HighLatency(Microservice):
    """Sends the message on request; CONTROL_HIGH_LATENCY sends nothing else to its sender.

    What the robot does not have (air, altitude of a goal) is 0, or what says so.
    """

    def streams(self) -> tuple[Stream, ...]:
        """Return the message, which is off."""
        return (Stream(common.MAVLINK_MSG_ID_HIGH_LATENCY2, self._build, 0.0),)

    def _build(self, now_ns: int) -> list[Message]:
        context = self._context
        control, navigation = context.fresh_control(now_ns), context.fresh_navigation(now_ns)
        if control is None:
            return []
        pose, origin = context.known_pose(now_ns), context.origin
        place, altitude_m = (0.0, 0.0), 0.0
        if pose is not None and origin is not None:
            place = origin.from_world(pose.x_m, pose.y_m)
            altitude_m = origin.altitude_m
        target_heading, distance = _goal(navigation, pose)
        personality = context.personality
        number = personality.modes[context.mode(now_ns)]
        battery = control.battery
        return [
            common.MAVLink_high_latency2_message(
                boot_ms(control.stamp_ns),
                common.MAV_TYPE_GROUND_ROVER,
                personality.autopilot,
                number >> 16 if personality.has_sub_modes else number,
                round(place[0] * SCALE),
                round(place[1] * SCALE),
                _altitude(altitude_m),
                _altitude(altitude_m),
                0 if pose is None else _half_degrees(pose.theta_rad),
                target_heading,
                distance,
                _power(control),
                0,
                0,
                _fifths(control.v_m_s),
                _UINT8,
                0,
                _UINT8,
                _UINT8,
                0,
                0,
                -1 if battery is None else percent(battery.charge),
                0 if navigation is None else min(navigation.item, 0xFFFF),
                _failures(context, control, navigation, knows_pose=pose is not None),
                0,
                0,
                0,
            )
        ]


def _goal(navigation: NavigationState | None, pose: SE2 | None) -> tuple[int, int]:
    """Return bearing [deg/2] and distance [dam] of the place that the robot drives to."""
    if navigation is None or navigation.goal is None or pose is None:
        return 0, 0
    x_m, y_m = navigation.goal[0] - pose.x_m, navigation.goal[1] - pose.y_m
    tens = round(math.hypot(x_m, y_m) / _DECAMETRE)
    return _half_degrees(math.atan2(y_m, x_m)), min(tens, 0xFFFF)


def _half_degrees(theta_rad: float) -> int:
    return round(math.degrees(yaw_ned_from_theta(theta_rad)) / 2.0) % 180


def _fifths(speed_m_s: float) -> int:
    return min(round(abs(speed_m_s) * _FIFTHS), _UINT8) if fit(speed_m_s) else 0


def _altitude(altitude_m: float) -> int:
    return round(min(max(altitude_m, -_MOST_ALTITUDE_M), _MOST_ALTITUDE_M))


def _power(control: ControlState) -> int:
    """Return the mean power of the motors [%]."""
    powers = [min(abs(each), 1.0) for each in control.duty if math.isfinite(each)]
    return round(100.0 * sum(powers) / len(powers)) if powers else 0


def _failures(
    context: Context,
    control: ControlState,
    navigation: NavigationState | None,
    *,
    knows_pose: bool,
) -> int:
    """Return HL_FAILURE_FLAG bits."""
    found = {
        common.HL_FAILURE_FLAG_BATTERY: control.battery is not None and control.battery.critical,
        common.HL_FAILURE_FLAG_ENGINE: control.state
        in {SafetyState.FAULT, SafetyState.EMERGENCY_STOP},
        common.HL_FAILURE_FLAG_GEOFENCE: navigation is not None and navigation.fence.breached,
        common.HL_FAILURE_FLAG_ESTIMATOR: context.robot.has_localiser and not knows_pose,
        common.HL_FAILURE_FLAG_MISSION: navigation is not None and navigation.mission_failed,
    }
    return sum(flag for flag, holds in found.items() if holds)
