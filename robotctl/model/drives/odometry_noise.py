"""Drift of dead reckoning: the noises e, f, g of `motion_noise.py`, as plain numbers.

Without numpy, since the robot's file holds them and the control process reads it. `motion_noise.py`
has their effect on a covariance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from robotctl.errors import InvalidValue


@dataclass(frozen=True, slots=True)
class MotionNoise:
    """Zero-mean noise of motion whose variance grows with distance and angle.

    Parameters
    ----------
    e_m_per_sqrt_m
        Standard deviation of the distance after 1 m [m], >= 0.
    f_rad_per_sqrt_m
        Standard deviation of the heading after 1 m of straight motion [rad], >= 0.
    g_rad_per_sqrt_rad
        Standard deviation of the heading after turning by 1 rad [rad], >= 0.

    Raises
    ------
    ValueError
        If a value is negative or not finite.
    """

    e_m_per_sqrt_m: float = 0.01
    f_rad_per_sqrt_m: float = 0.01
    g_rad_per_sqrt_rad: float = 0.01

    def __post_init__(self) -> None:
        for key in self.__slots__:
            value = getattr(self, key)
            if not (math.isfinite(value) and value >= 0.0):
                raise InvalidValue(key, f"must be finite and not negative, found {value}", value)

    def at_least(self, other: MotionNoise) -> MotionNoise:
        """Return the maximum of both, noise by noise."""
        return MotionNoise(
            *(max(getattr(self, key), getattr(other, key)) for key in self.__slots__)
        )
