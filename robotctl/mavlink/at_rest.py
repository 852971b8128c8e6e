"""Actions that only a disarmed robot at rest carries out: restarts, calibrations, motor tests."""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import common

from robotctl.mavlink.context import Context

REST_M_S: Final = 0.02
REST_RAD_S: Final = 0.1
"""Speed [m/s] and turning rate [rad/s] below which the robot is at rest: its encoders may flicker
between two counts."""


def objection(context: Context, now_ns: int) -> str:
    """Say why the robot is not known to be disarmed and at rest; empty if it is.

    Where its wheels are not heard, nothing is known of a motion, and the state decides alone.
    """
    control = context.fresh_control(now_ns)
    if control is None:
        return "control is silent"
    if context.is_armed(now_ns):
        return "the robot is armed, disarm it first"
    if any(number == common.MAV_CMD_COMPONENT_ARM_DISARM for _, number, _ in context.pending):
        return "a request to arm waits for its answer"
    if abs(control.v_m_s) > REST_M_S or abs(control.omega_rad_s) > REST_RAD_S:
        return (
            f"the robot moves at {control.v_m_s:.2f} m/s and {control.omega_rad_s:.2f} rad/s, "
            "wait until it stands"
        )
    return ""
