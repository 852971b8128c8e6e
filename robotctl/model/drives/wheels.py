"""Common parts of all drive models: references of the actuators, and checks of parameters."""

from __future__ import annotations

import math
from typing import Final

import msgspec

from robotctl.errors import InvalidValue

POSITIVE: Final = (0.0, math.inf)
"""Range of a value that calibration may set to anything above 0."""


class ActuatorReference(msgspec.Struct, frozen=True, gc=False):
    """Wanted speed of each driven wheel [rad/s] and angle of each joint [rad, positive left]."""

    wheels_rad_s: tuple[float, ...]
    joints_rad: tuple[float, ...]


def require_positive(drive: object, *keys: str) -> None:
    """Raise ValueError unless each attribute `keys` of `drive` is positive and finite."""
    for key in keys:
        value = getattr(drive, key)
        if not (math.isfinite(value) and value > 0):
            raise InvalidValue(key, f"must be positive and finite, found {value}", value)


def require_steering(steering_max_rad: float) -> None:
    """Raise ValueError unless a steering limit is in (0, pi/2) [rad]."""
    if not 0.0 < steering_max_rad < 0.5 * math.pi:
        raise InvalidValue(
            "steering_max_rad",
            f"must be between 0 and pi/2, both excluded, found {steering_max_rad}",
            steering_max_rad,
        )


def require_offset(steering_offset_rad: float, steering_max_rad: float) -> None:
    """Raise ValueError unless a steering with this offset reaches both sides and is under pi/2."""
    room_rad = min(steering_max_rad, 0.5 * math.pi - steering_max_rad)
    if not abs(steering_offset_rad) < room_rad:
        raise InvalidValue(
            "steering_offset_rad",
            f"must be between {-room_rad:.3g} and {room_rad:.3g}, which keeps the "
            "wheel's angle under pi/2 and both sides in reach, found "
            f"{steering_offset_rad}",
            steering_offset_rad,
        )


def offsets_near(steering_offset_rad: float, steering_max_rad: float) -> tuple[float, float]:
    """Return the minimum and maximum steering offset that calibration tries [rad]."""
    room_rad = min(steering_max_rad, 0.5 * math.pi - steering_max_rad) - abs(steering_offset_rad)
    return steering_offset_rad - 0.9 * room_rad, steering_offset_rad + 0.9 * room_rad


def steering_angle_rad(
    v_m_s: float,
    omega_rad_s: float,
    wheelbase_m: float,
    limit_rad: float,
    offset_rad: float = 0.0,
) -> float:
    """Return the servo angle that turns a body moving at `v_m_s` != 0 by `omega_rad_s` [rad].

    tan(s) = L omega / v for the wheel's angle s; the servo's is s - `offset_rad`, clamped to
    `limit_rad` on both sides [rad].
    """
    return within_linkage(math.atan(wheelbase_m * omega_rad_s / v_m_s) - offset_rad, limit_rad)


def within_linkage(angle_rad: float, limit_rad: float) -> float:
    """Return the servo angle clamped to the range of the linkage on both sides [rad].

    A nan stays one; the command guard rejects it.
    """
    if angle_rad > limit_rad:
        return limit_rad
    return max(angle_rad, -limit_rad)
