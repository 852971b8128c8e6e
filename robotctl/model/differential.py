"""Differential drive (notes, section 1.1)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

from robotctl.model.twist import Twist
from robotctl.model.wheels import WheelReference, require_positive


@dataclass(frozen=True, slots=True)
class DifferentialDrive:
    """Two driven wheels on one axle; turns on the spot.

    Parameters
    ----------
    kind
        Always "differential".
    track_width_m
        Distance of the wheels' contact points, W of the notes [m], > 0.
    wheel_radius_m
        Radius of both wheels [m], > 0.
    counts_per_revolution
        Quadrature counts per turn of a wheel, > 0.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    kind: Literal["differential"]
    track_width_m: float
    wheel_radius_m: float
    counts_per_revolution: int

    degrees_of_freedom: ClassVar[int] = 3
    """Of the pose in the plane: x, y, theta."""
    holonomic: ClassVar[bool] = False
    """It cannot move sideways at once: dy cos(theta) = dx sin(theta)."""
    steered: ClassVar[bool] = False
    wheel_names: ClassVar[tuple[str, ...]] = ("left", "right")

    def __post_init__(self) -> None:
        require_positive(self, "track_width_m", "wheel_radius_m", "counts_per_revolution")

    @property
    def min_turning_radius_m(self) -> float:
        """Smallest radius of the path of `base` [m]: 0, it turns on the spot."""
        return 0.0

    def inverse(
        self,
        v_m_s: float,
        omega_rad_s: float,
        steering_meas_rad: float = 0.0,  # noqa: ARG002 - all drives share one signature
    ) -> WheelReference:
        """Return the wheel speeds for a body velocity; `steering_meas_rad` is not used."""
        difference = 0.5 * self.track_width_m * omega_rad_s
        radius = self.wheel_radius_m
        return WheelReference((v_m_s - difference) / radius, (v_m_s + difference) / radius, 0.0)

    def forward(
        self,
        omega1_rad_s: float,
        omega2_rad_s: float,
        steering_rad: float = 0.0,  # noqa: ARG002 - all drives share one signature
    ) -> Twist:
        """Return the velocity of `base` for wheel speeds; `steering_rad` is not used."""
        radius = self.wheel_radius_m
        return Twist(
            0.5 * radius * (omega1_rad_s + omega2_rad_s),
            radius * (omega2_rad_s - omega1_rad_s) / self.track_width_m,
        )

    def turning_radius_m(self, v_left_m_s: float, v_right_m_s: float) -> float:
        """Return R = (W/2) (v_R + v_L) / (v_R - v_L) [m]: positive left, inf if not turning."""
        difference = v_right_m_s - v_left_m_s
        if difference == 0.0:
            return math.inf
        return 0.5 * self.track_width_m * (v_right_m_s + v_left_m_s) / difference
