"""Speed, acceleration and jerk limits on the body velocity: the last layer for every set-point.

Each axis follows its set-point as fast as its limits allow and without overshooting it. With step
h, jerk limit j and e the distance to the set-point, the next acceleration is the largest a with::

    a h + a^2 / (2 j) <= e        so        a = sqrt((j h)^2 + 2 j e) - j h

because after one step with a it takes a^2 / (2 j) at most to bring a to zero. It is then bounded
by the acceleration limit and by what the jerk limit allows from the present acceleration. The
condition, once met, stays met for every later step length, so neither the set-point nor the speed
limit is overshot, except a set-point that itself moves back faster than jerk allows to follow.
The price: a set-point that moves with acceleration a is followed late by a / (2 j) seconds, since
it might stop at any moment.

For the continuous form see L. Biagiotti and C. Melchiorri, *Trajectory Planning for Automatic
Machines and Robots* (2008), sections 3.4 and 4.6 (on-line filters).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Final

from robotctl.errors import InvalidValue
from robotctl.model.geometry.twist import Twist

_LANDED: Final = 1e-9
"""Remaining distance below which the set-point is reached in one step [m/s, rad/s]."""
_REST: Final = Twist(0.0, 0.0)


@dataclass(frozen=True, slots=True)
class LimitsConfig:
    """Limits of the body velocity, for both directions.

    Parameters
    ----------
    v_max_m_s, omega_max_rad_s
        Maximum speed [m/s] and turning rate [rad/s], > 0.
    a_max_m_s2, alpha_max_rad_s2
        Maximum acceleration [m/s^2] and angular acceleration [rad/s^2], > 0, also for braking.
    jerk_max_m_s3, angular_jerk_max_rad_s3
        Maximum jerk [m/s^3] and angular jerk [rad/s^3], > 0.
    vy_max_m_s
        Maximum sideways speed [m/s], >= 0; more than 0 on holonomic drives only. Sideways
        acceleration and jerk have the limits of the forward ones.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    v_max_m_s: float = 0.5
    omega_max_rad_s: float = 2.0
    a_max_m_s2: float = 1.0
    alpha_max_rad_s2: float = 4.0
    jerk_max_m_s3: float = 10.0
    angular_jerk_max_rad_s3: float = 40.0
    vy_max_m_s: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value, may_be_zero = getattr(self, field.name), field.name == "vy_max_m_s"
            if not (0.0 < value < math.inf or (may_be_zero and value == 0.0)):
                allowed = "a finite number >= 0" if may_be_zero else "a finite number > 0"
                raise InvalidValue(field.name, f"{value} found, {allowed} allowed", value)


def scale_to_limits(wanted: Twist, limits: LimitsConfig) -> Twist:
    """Return the set-point scaled to the speed limits, on the same arc.

    All parts are multiplied by the same factor, so that the curvature is kept and the robot drives
    the same path more slowly. A set-point that is not finite is a stop; the sideways part is
    dropped for a robot that cannot move sideways.
    """
    v_m_s, omega_rad_s, vy_m_s = wanted
    if not math.isfinite(v_m_s + omega_rad_s + vy_m_s):
        return _REST
    v_max, omega_max, vy_max = limits.v_max_m_s, limits.omega_max_rad_s, limits.vy_max_m_s
    excess = max(abs(v_m_s) / v_max, abs(omega_rad_s) / omega_max)
    if vy_max > 0.0:
        excess = max(excess, abs(vy_m_s) / vy_max)
    elif vy_m_s != 0.0:
        wanted, vy_m_s = Twist(v_m_s, omega_rad_s), 0.0
    if excess <= 1.0:
        return wanted
    # Clamped again, since the division may round upwards.
    return Twist(
        min(max(v_m_s / excess, -v_max), v_max),
        min(max(omega_rad_s / excess, -omega_max), omega_max),
        min(max(vy_m_s / excess, -vy_max), vy_max),
    )


def next_acceleration(
    remaining: float, acceleration: float, acceleration_max: float, jerk_max: float, dt_s: float
) -> float:
    """Return the acceleration of the next step towards a set-point, as the module describes.

    Parameters
    ----------
    remaining
        Set-point minus present value, in any unit U.
    acceleration
        Acceleration of the last step [U/s].
    acceleration_max, jerk_max
        Limits [U/s, U/s^2], > 0.
    dt_s
        Length of the step [s], > 0.
    """
    change = jerk_max * dt_s
    distance = remaining if remaining >= 0.0 else -remaining
    if distance < _LANDED:
        # The formula comes near the set-point without ever meeting it exactly.
        wanted = distance / dt_s
    else:
        # The conjugate form of sqrt(change^2 + 2 j e) - change: no cancellation near the set-point.
        twice = 2.0 * jerk_max * distance
        wanted = twice / (math.sqrt(change * change + twice) + change)
    wanted = min(wanted, acceleration_max)
    if remaining < 0.0:
        wanted = -wanted
    if wanted > acceleration + change:
        return acceleration + change
    if wanted < acceleration - change:
        return acceleration - change
    return wanted


class TwistLimiter:
    """Follows a moving set-point within the limits; the axes are limited independently in time.

    A set-point that is too fast is scaled as a whole, see `scale_to_limits`. While speeds change,
    each axis uses its own acceleration and jerk, so the curvature is reached when all have arrived.

    Attributes
    ----------
    twist
        The last output.
    acceleration
        Acceleration of the last step [m/s^2, rad/s^2, m/s^2], for feed-forward.
    """

    __slots__ = ("_config", "acceleration", "twist")

    def __init__(self, config: LimitsConfig) -> None:
        self._config = config
        self.twist = self.acceleration = _REST

    def retune(self, config: LimitsConfig) -> None:
        """Change the limits; an axis that is now too fast slows down within its other limits."""
        self._config = config

    def reset(self, twist: Twist = _REST, acceleration: Twist = _REST) -> None:
        """Continue from this velocity and acceleration: the present state, for a smooth start.

        The velocity is clamped to the speed limits; parts that are not finite count as 0.
        """
        config = self._config
        bounds = config.v_max_m_s, config.omega_max_rad_s, config.vy_max_m_s
        self.twist = Twist(
            *(
                min(max(each, -bound), bound) if math.isfinite(each) else 0.0
                for each, bound in zip(twist, bounds, strict=True)
            )
        )
        self.acceleration = acceleration

    def step(self, wanted: Twist, dt_s: float) -> Twist:
        """Return the velocity to command now.

        Parameters
        ----------
        wanted
            Set-point; a value that is not finite makes it a stop.
        dt_s
            Time since the last call [s]; if it is not positive and finite, the last output is
            returned and nothing changes.
        """
        if not 0.0 < dt_s < math.inf:
            return self.twist
        limits = self._config
        v_ref, omega_ref, vy_ref = scale_to_limits(wanted, limits)
        v, omega, vy = self.twist
        a, alpha, ay = self.acceleration
        a = next_acceleration(v_ref - v, a, limits.a_max_m_s2, limits.jerk_max_m_s3, dt_s)
        alpha = next_acceleration(
            omega_ref - omega,
            alpha,
            limits.alpha_max_rad_s2,
            limits.angular_jerk_max_rad_s3,
            dt_s,
        )
        if limits.vy_max_m_s > 0.0:
            ay = next_acceleration(vy_ref - vy, ay, limits.a_max_m_s2, limits.jerk_max_m_s3, dt_s)
        self.acceleration = Twist(a, alpha, ay)
        self.twist = Twist(v + a * dt_s, omega + alpha * dt_s, vy + ay * dt_s)
        return self.twist
