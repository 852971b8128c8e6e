"""NAV_SET_YAW_SPEED: a heading and a speed for a robot in GUIDED."""

from __future__ import annotations

import math
from typing import Final

from pymavlink.dialects.v20 import common

from robotctl.mavlink.command import ACCEPTED, DENIED, TEMPORARILY_REJECTED, Command
from robotctl.mavlink.frames import theta_from_yaw_ned
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import Mode, VelocityTarget
from robotctl.safety.state_machine import POWERED

_RELATIVE: Final = 1
"""Param3 of NAV_SET_YAW_SPEED: the yaw counts from the present heading."""


class YawSpeeds(Microservice):
    """Takes param1, the yaw [deg], param2, the speed [m/s], and param3, 1: relative to now."""

    commands = frozenset({common.MAV_CMD_NAV_SET_YAW_SPEED})

    def on_command(self, command: Command, now_ns: int) -> int:
        """Drive along a direction until that expires, as any velocity does."""
        context = self._context
        control, pose = context.fresh_control(now_ns), context.known_pose(now_ns)
        yaw_deg, speed_m_s, relative = command.params[:3]
        if not math.isfinite(yaw_deg) or not math.isfinite(speed_m_s) or relative not in {0.0, 1.0}:
            return DENIED
        if context.mode(now_ns) is not Mode.GUIDED or control is None:
            context.say(now_ns, "Yaw and speed: in GUIDED only")
            return TEMPORARILY_REJECTED
        if control.state not in POWERED or pose is None:
            why = "the heading is not known" if pose is None else "not armed"
            context.say(now_ns, f"Yaw and speed: {why}")
            return TEMPORARILY_REJECTED
        yaw_rad = math.radians(math.remainder(yaw_deg, 360.0))
        turned_rad = pose.theta_rad - yaw_rad
        heading_rad = turned_rad if relative == _RELATIVE else theta_from_yaw_ned(yaw_rad)
        expires_ns = now_ns + context.setpoint_life_ns
        request = VelocityTarget(now_ns, expires_ns, speed_m_s, 0.0, heading_rad)
        context.requests.append(request)
        return ACCEPTED
