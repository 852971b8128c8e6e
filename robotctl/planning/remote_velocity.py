"""Remote velocities: sticks, and set-points of a ground station."""

from __future__ import annotations

import math

from robotctl.control.limiter import LimitsConfig
from robotctl.messages.requests import StickRequest, VelocityRequest
from robotctl.model.drives.drives import Drive
from robotctl.planning.behaviours.guarded import limited
from robotctl.planning.guard.behaviour import BehaviourOutput
from robotctl.planning.guard.obstacle_guard import ObstacleGuard
from robotctl.planning.local.heading_control import towards


def stick_velocity(
    sticks: StickRequest | None, limits: LimitsConfig, drive: Drive, now_ns: int
) -> BehaviourOutput:
    """Return the velocity of the sticks, scaled to the limits; rest once they have expired."""
    if sticks is None or now_ns >= sticks.expires_ns:
        return BehaviourOutput(0.0, 0.0, text="no sticks")
    forward, turn = _unit(sticks.forward), _unit(sticks.turn)
    v = forward * limits.v_max_m_s
    if drive.steered:
        return BehaviourOutput(v, turn * v / drive.min_turning_radius_m)
    return BehaviourOutput(v, turn * limits.omega_max_rad_s)


def guided_velocity(
    target: VelocityRequest, heading_rad: float, drive: Drive, guard: ObstacleGuard, now_ns: int
) -> BehaviourOutput:
    """Return the velocity of a ground station, as far as the guard allows.

    `heading_rad` is the robot's own in `world` [rad].
    """
    wanted = BehaviourOutput(target.v_m_s, target.omega_rad_s)
    if target.heading_rad is not None:
        twist = towards(target.heading_rad, target.v_m_s, heading_rad, steered=drive.steered)
        wanted = BehaviourOutput(twist.v_m_s, twist.omega_rad_s)
    if now_ns >= target.expires_ns or not math.isfinite(wanted.v_m_s + wanted.omega_rad_s):
        return BehaviourOutput(0.0, 0.0, text="no valid velocity")
    if drive.steered:
        if wanted.v_m_s == 0.0 and wanted.omega_rad_s != 0.0:
            return BehaviourOutput(0.0, 0.0, text="this robot cannot turn on the spot")
        return limited(wanted, guard)[0]
    step = limited(wanted, guard)[0]
    # Blocked, it may still turn away: the body turns on the spot as it does where v is 0.
    turn = limited(wanted._replace(v_m_s=0.0), guard)[0]
    return step if step.v_m_s else step._replace(omega_rad_s=turn.omega_rad_s)


def _unit(stick: float) -> float:
    """Return a stick clamped to [-1, 1], 0 if it is not finite."""
    return min(max(stick, -1.0), 1.0) if math.isfinite(stick) else 0.0
