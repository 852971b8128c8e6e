"""Path of a robot that follows a velocity for a while and then brakes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final, NamedTuple

from robotctl.control.limiter import LimitsConfig, TwistLimiter
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist

_REST: Final = 1e-3
"""Slower counts as standing [m/s, rad/s]."""
_STANDS: Final = Twist(0.0, 0.0)


class MotionNow(NamedTuple):
    """The robot's motion as of the last word of control."""

    pose: SE2
    """`base` in `world`."""
    twist: Twist
    """Its velocity."""
    acceleration: Twist
    """The change of that [m/s^2, rad/s^2, m/s^2]."""
    before: Twist
    """The velocity last commanded."""
    lag_s: float
    """Time for which it is still followed, until a new one reaches the wheels [s]."""


def predict(
    now: MotionNow, wanted: Twist, follow_s: float, limits: LimitsConfig, dt_s: float
) -> list[tuple[float, float, float]]:
    """Return the poses x, y, theta [m, rad] until the robot stands, `dt_s` apart.

    It follows `now.before` for its lag, `wanted` for `follow_s`, and brakes then, as the set-point
    limiter of control does.
    """
    limiter = TwistLimiter(limits)
    limiter.reset(now.twist, now.acceleration)
    x, y, theta = now.pose.x_m, now.pose.y_m, now.pose.theta_rad
    poses = [(x, y, theta)]
    for target in _targets(now, wanted, follow_s, dt_s):
        v, omega, vy = limiter.step(target, dt_s)
        if target is _STANDS and max(abs(v), abs(omega), abs(vy)) < _REST:
            break
        middle = theta + 0.5 * omega * dt_s
        cos, sin = math.cos(middle), math.sin(middle)
        x += (v * cos - vy * sin) * dt_s
        y += (v * sin + vy * cos) * dt_s
        theta += omega * dt_s
        poses.append((x, y, theta))
    return poses


def longest_way(
    now: MotionNow, wanted: Twist, follow_s: float, limits: LimitsConfig, reach_m: float
) -> float:
    """Return a bound of the way of any point of the body until the robot stands [m]."""
    v = max(math.hypot(each.v_m_s, each.vy_m_s) for each in (now.twist, now.before, wanted))
    omega = max(abs(each.omega_rad_s) for each in (now.twist, now.before, wanted))
    ramp_s = limits.a_max_m_s2 / limits.jerk_max_m_s3
    turn_ramp_s = limits.alpha_max_rad_s2 / limits.angular_jerk_max_rad_s3
    # The present acceleration goes on while it falls to zero; sideways, too, on holonomic robots.
    axes = math.sqrt(2.0) if limits.vy_max_m_s > 0.0 else 1.0
    v += 0.5 * axes * limits.a_max_m_s2 * ramp_s
    omega += 0.5 * limits.alpha_max_rad_s2 * turn_ramp_s
    brake_s = max(
        v / limits.a_max_m_s2 + 2.0 * ramp_s,
        omega / limits.alpha_max_rad_s2 + 2.0 * turn_ramp_s,
    )
    return (v + omega * reach_m) * (now.lag_s + follow_s + brake_s)


def _targets(now: MotionNow, wanted: Twist, follow_s: float, dt_s: float) -> Iterator[Twist]:
    """Yield the set-point of each step; the last one for ever."""
    for _ in range(math.ceil(now.lag_s / dt_s)):
        yield now.before
    for _ in range(math.ceil(follow_s / dt_s)):
        yield wanted
    while True:
        yield _STANDS
