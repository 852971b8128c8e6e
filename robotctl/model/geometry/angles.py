"""Angles on the circle."""

from __future__ import annotations

import math


def wrap_angle(angle_rad: float) -> float:
    """Return `angle_rad` wrapped to (-pi, pi] [rad]; nan stays nan.

    Raises
    ------
    ValueError
        If `angle_rad` is infinite.
    """
    wrapped = math.remainder(angle_rad, math.tau)
    return math.pi if wrapped <= -math.pi else wrapped


def sinc(angle_rad: float) -> float:
    """Return sin(x) / x for x in rad, 1 at 0; a series near 0, exact to rounding."""
    if abs(angle_rad) < 1e-4:
        return 1.0 - angle_rad * angle_rad / 6.0
    return math.sin(angle_rad) / angle_rad
