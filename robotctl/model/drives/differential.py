"""Differential drive (Siegwart et al.: Autonomous Mobile Robots, section 3.2)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Final, Literal

from robotctl.errors import InvalidValue
from robotctl.model.drives.linear import LinearDrive
from robotctl.model.drives.wheels import POSITIVE, ActuatorReference, require_positive
from robotctl.model.geometry.twist import Twist

RATIOS: Final = (0.5, 2.0)
"""Minimum and maximum ratio of the wheel radii."""


@dataclass(frozen=True, slots=True)
class DifferentialDrive(LinearDrive):
    """Two driven wheels on one axle: dy cos(theta) = dx sin(theta); turns on the spot.

    Parameters
    ----------
    kind
        Always "differential".
    track_width_m
        Distance of the wheels' contact points [m], > 0.
    wheel_radius_m
        Mean radius of the two wheels [m], > 0.
    counts_per_revolution
        Quadrature counts per turn of a wheel, > 0.
    wheel_radius_ratio
        Radius of the right wheel over that of the left, in [0.5, 2]; from calibration.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    kind: Literal["differential"]
    track_width_m: float
    wheel_radius_m: float
    counts_per_revolution: int
    wheel_radius_ratio: float = 1.0

    calibrated: ClassVar[Mapping[str, tuple[float, float]]] = {
        "wheel_radius_m": POSITIVE,
        "wheel_radius_ratio": RATIOS,
        "track_width_m": POSITIVE,
    }
    wheel_names: ClassVar[tuple[str, ...]] = ("left", "right")

    def __post_init__(self) -> None:
        require_positive(self, "track_width_m", "wheel_radius_m", "counts_per_revolution")
        if not RATIOS[0] <= self.wheel_radius_ratio <= RATIOS[1]:
            raise InvalidValue(
                "wheel_radius_ratio",
                f"must be between 0.5 and 2, found {self.wheel_radius_ratio}",
                self.wheel_radius_ratio,
            )

    @property
    def wheel_radii_m(self) -> tuple[float, ...]:
        """Radius of the left and of the right wheel [m]."""
        left_m = 2.0 * self.wheel_radius_m / (1.0 + self.wheel_radius_ratio)
        return left_m, self.wheel_radius_ratio * left_m

    def inverse(
        self,
        twist: Twist,
        joints_meas_rad: tuple[float, ...] = (),  # noqa: ARG002 - all drives share one signature
    ) -> ActuatorReference:
        """Return the wheel speeds for a body velocity; `joints_meas_rad` is not used."""
        difference = 0.5 * self.track_width_m * twist.omega_rad_s
        left_m, right_m = self.wheel_radii_m
        v_m_s = twist.v_m_s
        return ActuatorReference(
            ((v_m_s - difference) / left_m, (v_m_s + difference) / right_m), ()
        )

    def forward(
        self,
        wheels_rad_s: tuple[float, ...],
        joints_rad: tuple[float, ...] = (),  # noqa: ARG002 - all drives share one signature
    ) -> Twist:
        """Return the velocity of `base` for wheel speeds; `joints_rad` is not used."""
        left_m, right_m = self.wheel_radii_m
        left_rad_s, right_rad_s = wheels_rad_s
        v_left_m_s, v_right_m_s = left_m * left_rad_s, right_m * right_rad_s
        return Twist(
            0.5 * (v_left_m_s + v_right_m_s), (v_right_m_s - v_left_m_s) / self.track_width_m
        )

    def turning_radius_m(self, v_left_m_s: float, v_right_m_s: float) -> float:
        """Return R = (W/2) (v_R + v_L) / (v_R - v_L) [m]: positive left, inf if not turning."""
        difference = v_right_m_s - v_left_m_s
        if difference == 0.0:
            return math.inf
        return 0.5 * self.track_width_m * (v_right_m_s + v_left_m_s) / difference
