"""Velocity of a planar robot."""

from __future__ import annotations

from typing import NamedTuple


class Twist(NamedTuple):
    """Velocity of `base`: `v_m_s` forward [m/s], `omega_rad_s` to the left [rad/s].

    There is no sideways part: no drive model here can move sideways.
    """

    v_m_s: float
    omega_rad_s: float
