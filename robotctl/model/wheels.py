"""What all drive models share: wheel references, and checks of their parameters."""

from __future__ import annotations

import math
from typing import NamedTuple


class WheelReference(NamedTuple):
    """Wanted wheel speeds [rad/s] and steering angle [rad, positive left]."""

    omega1_rad_s: float
    omega2_rad_s: float
    steering_rad: float


class SidePair(NamedTuple):
    """A quantity of the left and of the right wheel of one axle."""

    left: float
    right: float


def require_positive(drive: object, *keys: str) -> None:
    """Raise ValueError unless each attribute `keys` of `drive` is positive and finite."""
    for key in keys:
        value = getattr(drive, key)
        if not (math.isfinite(value) and value > 0):
            raise ValueError(f"{key} must be positive and finite")


def require_steering(steering_max_rad: float) -> None:
    """Raise ValueError unless a steering limit is in (0, pi/2) [rad]."""
    if not 0.0 < steering_max_rad < 0.5 * math.pi:
        raise ValueError("steering_max_rad must be between 0 and pi/2, both excluded")


def steering_angle_rad(
    v_m_s: float, omega_rad_s: float, wheelbase_m: float, limit_rad: float
) -> float:
    """Return the steering angle that turns a body moving at `v_m_s` != 0 by `omega_rad_s`.

    tan(s) = L omega / v, clamped to `limit_rad` on both sides [rad].
    """
    angle = math.atan(wheelbase_m * omega_rad_s / v_m_s)
    if angle > limit_rad:
        return limit_rad
    return max(angle, -limit_rad)
