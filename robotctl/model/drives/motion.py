"""Planar motion with constant velocity: straight, turn and arc.

All poses are of `base` in a fixed frame. Each function is exact while the velocities are constant
and no wheel slips.
"""

from __future__ import annotations

import math

from robotctl.model.geometry.angles import sinc, wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist


def straight(pose: SE2, distance_m: float) -> SE2:
    """Return `pose` after driving `distance_m` straight on; negative is backwards [m]."""
    return SE2(
        pose.x_m + distance_m * math.cos(pose.theta_rad),
        pose.y_m + distance_m * math.sin(pose.theta_rad),
        wrap_angle(pose.theta_rad),
    )


def turn(pose: SE2, angle_rad: float) -> SE2:
    """Return `pose` after turning `angle_rad` to the left on the spot [rad]."""
    return SE2(pose.x_m, pose.y_m, wrap_angle(pose.theta_rad + angle_rad))


def arc(pose: SE2, distance_m: float, angle_rad: float, sideways_m: float = 0.0) -> SE2:
    """Return `pose` after an arc of length `distance_m` [m] that turns by `angle_rad` [rad].

    In chord form: the chord has the length `d sinc(angle/2)` and the direction
    `theta + angle/2`, so that neither straight motion nor turning on the spot is a special case.
    A holonomic robot also moves `sideways_m` to the left meanwhile [m]; its chord is the sum of
    both.
    """
    half = 0.5 * angle_rad
    share = sinc(half)
    chord, across = distance_m * share, sideways_m * share
    cos, sin = math.cos(pose.theta_rad + half), math.sin(pose.theta_rad + half)
    return SE2(
        pose.x_m + chord * cos - across * sin,
        pose.y_m + chord * sin + across * cos,
        wrap_angle(pose.theta_rad + angle_rad),
    )


def integrate(pose: SE2, twist: Twist, dt_s: float) -> SE2:
    """Return `pose` after `dt_s` [s] of a constant velocity."""
    return arc(pose, twist.v_m_s * dt_s, twist.omega_rad_s * dt_s, twist.vy_m_s * dt_s)


def between(before: SE2, after: SE2, share: float) -> SE2:
    """Return the pose at a fraction [0, 1] between two that are near each other.

    Position and heading are interpolated linearly, the heading along the shorter arc.
    """
    return SE2(
        before.x_m + share * (after.x_m - before.x_m),
        before.y_m + share * (after.y_m - before.y_m),
        wrap_angle(before.theta_rad + share * wrap_angle(after.theta_rad - before.theta_rad)),
    )
