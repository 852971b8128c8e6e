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
"""A remaining distance below this is taken in one step [m/s, rad/s]."""


@dataclass(frozen=True, slots=True)
class LimitsConfig:
    """Limits of the body velocity, for both directions.

    Parameters
    ----------
    v_max_m_s, omega_max_rad_s
        Largest speed [m/s] and turning rate [rad/s], > 0.
    a_max_m_s2, alpha_max_rad_s2
        Largest acceleration [m/s^2] and angular acceleration [rad/s^2], > 0, also for braking.
    jerk_max_m_s3, angular_jerk_max_rad_s3
        Largest jerk [m/s^3] and angular jerk [rad/s^3], > 0.

    Raises
    ------
    ValueError
        If a value is not positive and finite.
    """

    v_max_m_s: float = 0.5
    omega_max_rad_s: float = 2.0
    a_max_m_s2: float = 1.0
    alpha_max_rad_s2: float = 4.0
    jerk_max_m_s3: float = 10.0
    angular_jerk_max_rad_s3: float = 40.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0.0 < value < math.inf:
                raise InvalidValue(field.name, f"{value} found, a finite number > 0 allowed", value)


def scale_to_limits(v_m_s: float, omega_rad_s: float, v_max: float, omega_max: float) -> Twist:
    """Return the set-point scaled to the speed limits, on the same arc.

    Both parts are multiplied by the same factor, so that the curvature omega / v is kept and the
    robot drives the wanted path more slowly. A set-point that is not finite is a stop.
    """
    if not math.isfinite(v_m_s + omega_rad_s):
        return Twist(0.0, 0.0)
    excess = max(abs(v_m_s) / v_max, abs(omega_rad_s) / omega_max)
    if excess <= 1.0:
        return Twist(v_m_s, omega_rad_s)
    # The bounds again, since the division may round upwards.
    return Twist(
        min(max(v_m_s / excess, -v_max), v_max),
        min(max(omega_rad_s / excess, -omega_max), omega_max),
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
    # The conjugate form of sqrt(change^2 + 2 j e) - change: no cancellation near the set-point.
    twice = 2.0 * jerk_max * distance
    wanted = twice / (math.sqrt(change * change + twice) + change)
    # The formula comes near the set-point without ever meeting it exactly.
    if distance < _LANDED:
        wanted = distance / dt_s
    wanted = min(wanted, acceleration_max)
    if remaining < 0.0:
        wanted = -wanted
    if wanted > acceleration + change:
        return acceleration + change
    if wanted < acceleration - change:
        return acceleration - change
    return wanted


class TwistLimiter:
    """Follows a moving set-point within the limits; both axes are limited independently in time.

    The rule where a set-point is too fast: it is scaled as a whole, see `scale_to_limits`. While
    speeds change, each axis uses its own acceleration and jerk, so the curvature is met when both
    have arrived.
    """

    __slots__ = ("_a", "_alpha", "_config", "_omega", "_v")

    def __init__(self, config: LimitsConfig) -> None:
        self._config = config
        self.reset()

    @property
    def twist(self) -> Twist:
        """The last output."""
        return Twist(self._v, self._omega)

    @property
    def acceleration_m_s2(self) -> float:
        """Acceleration of the last step [m/s^2], for feed-forward."""
        return self._a

    @property
    def angular_acceleration_rad_s2(self) -> float:
        """Angular acceleration of the last step [rad/s^2], for feed-forward."""
        return self._alpha

    def retune(self, config: LimitsConfig) -> None:
        """Change the limits; what is faster than allowed now slows down within the others."""
        self._config = config

    def reset(
        self,
        v_m_s: float = 0.0,
        omega_rad_s: float = 0.0,
        a_m_s2: float = 0.0,
        alpha_rad_s2: float = 0.0,
    ) -> None:
        """Continue from this velocity and acceleration: the present state, for a smooth start.

        The velocity is clamped to the speed limits; what of it is not finite counts as 0.
        """
        config = self._config
        v = v_m_s if math.isfinite(v_m_s) else 0.0
        omega = omega_rad_s if math.isfinite(omega_rad_s) else 0.0
        self._v = min(max(v, -config.v_max_m_s), config.v_max_m_s)
        self._omega = min(max(omega, -config.omega_max_rad_s), config.omega_max_rad_s)
        self._a = a_m_s2
        self._alpha = alpha_rad_s2

    def step(self, v_ref_m_s: float, omega_ref_rad_s: float, dt_s: float) -> Twist:
        """Return the velocity to command now.

        Parameters
        ----------
        v_ref_m_s, omega_ref_rad_s
            Wanted velocity; a value that is not finite makes it a stop.
        dt_s
            Time since the last call [s]; if it is not positive and finite, the last output is
            returned and nothing changes.
        """
        if not 0.0 < dt_s < math.inf:
            return Twist(self._v, self._omega)
        limits = self._config
        v_ref, omega_ref = scale_to_limits(
            v_ref_m_s, omega_ref_rad_s, limits.v_max_m_s, limits.omega_max_rad_s
        )
        self._a = next_acceleration(
            v_ref - self._v, self._a, limits.a_max_m_s2, limits.jerk_max_m_s3, dt_s
        )
        self._alpha = next_acceleration(
            omega_ref - self._omega,
            self._alpha,
            limits.alpha_max_rad_s2,
            limits.angular_jerk_max_rad_s3,
            dt_s,
        )
        self._v += self._a * dt_s
        self._omega += self._alpha * dt_s
        return Twist(self._v, self._omega)
