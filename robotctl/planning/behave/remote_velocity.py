"""Remote velocities: sticks, and set-points of a ground station."""

from __future__ import annotations

import math

from robotctl.control.limiter import LimitsConfig
from robotctl.messages.requests import StickRequest, VelocityRequest
from robotctl.model.drives.drives import Drive
from robotctl.model.geometry.twist import Twist
from robotctl.planning.behave.behaviours.behaviour import BehaviourOutput
from robotctl.planning.behave.behaviours.guarded import limited
from robotctl.planning.guard.obstacle_guard import ObstacleGuard
from robotctl.planning.path.local.heading_control import towards, turn_towards


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
    vy = _unit(sticks.sideways) * limits.vy_max_m_s if drive.holonomic else 0.0
    return BehaviourOutput(v, turn * limits.omega_max_rad_s, vy_m_s=vy)


def guided_velocity(
    target: VelocityRequest, heading_rad: float, drive: Drive, guard: ObstacleGuard, now_ns: int
) -> BehaviourOutput:
    """Return the velocity of a ground station; where the guard lets it not drive, its turn alone.

    `heading_rad` is the robot's own in `world` [rad].
    """
    twist = _wanted(target, heading_rad, drive)
    wanted = BehaviourOutput(twist.v_m_s, twist.omega_rad_s, vy_m_s=twist.vy_m_s)
    if now_ns >= target.expires_ns or not math.isfinite(math.fsum(twist)):
        return BehaviourOutput(0.0, 0.0, text="no valid velocity")
    if drive.steered:
        if wanted.v_m_s == 0.0 and wanted.omega_rad_s != 0.0:
            return BehaviourOutput(0.0, 0.0, text="this robot cannot turn on the spot")
        return wanted
    slowed, _ = limited(wanted, guard)
    if slowed.twist.speed_m_s:
        return wanted
    # Blocked, it may still turn away: the body turns on the spot as it does where v is 0.
    return wanted._replace(v_m_s=0.0, vy_m_s=0.0, text=slowed.text)


def _wanted(target: VelocityRequest, heading_rad: float, drive: Drive) -> Twist:
    """Return a velocity of `base`, as it is asked for; sideways of holonomic drives alone."""
    v, vy, omega = target.v_m_s, target.vy_m_s, target.omega_rad_s
    if target.in_world:
        c, s = math.cos(heading_rad), math.sin(heading_rad)
        v, vy = c * v + s * vy, c * vy - s * v
    elif target.heading_rad is not None:
        return towards(target.heading_rad, v, heading_rad, steered=drive.steered)
    if target.heading_rad is not None:
        omega = turn_towards(target.heading_rad, heading_rad)
    return Twist(v, omega, vy if drive.holonomic else 0.0)


def _unit(stick: float) -> float:
    """Return a stick clamped to [-1, 1], 0 if it is not finite."""
    return min(max(stick, -1.0), 1.0) if math.isfinite(stick) else 0.0
