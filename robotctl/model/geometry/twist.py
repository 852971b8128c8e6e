"""Velocity of a planar robot."""

from __future__ import annotations

import math
from typing import NamedTuple


class Twist(NamedTuple):
    """Velocity of `base`: forward [m/s], turning to the left [rad/s], sideways to the left [m/s].

    Only holonomic drives (`Drive.holonomic`) move sideways; all others leave `vy_m_s` at 0.
    """

    v_m_s: float
    omega_rad_s: float
    vy_m_s: float = 0.0

    @property
    def speed_m_s(self) -> float:
        """Speed of `base` over the floor [m/s], >= 0."""
        return math.hypot(self.v_m_s, self.vy_m_s) if self.vy_m_s else abs(self.v_m_s)

    def scaled(self, share: float) -> Twist:
        """Return a share of it, on the same arc."""
        return Twist(share * self.v_m_s, share * self.omega_rad_s, share * self.vy_m_s)
