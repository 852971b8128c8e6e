"""Three or four omni wheels around a centre, which move the robot in any direction."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

from robotctl.errors import InvalidValue
from robotctl.model.drives.linear import LinearDrive
from robotctl.model.drives.wheels import POSITIVE, ActuatorReference, require_positive
from robotctl.model.geometry.twist import Twist


@dataclass(frozen=True, slots=True)
class OmniDrive(LinearDrive):
    """Driven wheels on a circle around `base`, each rolling along it, with rollers across.

    A positive speed of any wheel turns the robot to the left. Source: F. G. Pin and
    S. M. Killough, "A new family of omnidirectional and holonomic wheeled platforms for mobile
    robots", IEEE Trans. Robotics and Automation 10(4), 1994.

    Parameters
    ----------
    kind
        Always "omni".
    wheels
        Number of wheels, 3 or 4, evenly spaced.
    wheel_distance_m
        Distance of the contact points from `base` [m], > 0.
    wheel_radius_m
        Radius of the wheels [m], > 0.
    counts_per_revolution
        Quadrature counts per turn of a wheel, > 0.
    first_wheel_deg
        Bearing of wheel 1 [deg], counter-clockwise from forward, in [-180, 180]; the others follow
        counter-clockwise.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    kind: Literal["omni"]
    wheels: Literal[3, 4]
    wheel_distance_m: float
    wheel_radius_m: float
    counts_per_revolution: int
    first_wheel_deg: float = 60.0

    calibrated: ClassVar[Mapping[str, tuple[float, float]]] = {
        "wheel_radius_m": POSITIVE,
        "wheel_distance_m": POSITIVE,
    }
    holonomic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        require_positive(self, "wheel_distance_m", "wheel_radius_m", "counts_per_revolution")
        if not abs(self.first_wheel_deg) <= 180.0:
            raise InvalidValue(
                "first_wheel_deg",
                f"must be between -180 and 180, found {self.first_wheel_deg}",
                self.first_wheel_deg,
            )

    @property
    def wheel_names(self) -> tuple[str, ...]:
        """Names of the wheels, counter-clockwise."""
        return tuple(f"wheel_{k}" for k in range(1, self.wheels + 1))

    @property
    def wheel_radii_m(self) -> tuple[float, ...]:
        """Radius of each wheel [m]."""
        return (self.wheel_radius_m,) * self.wheels

    @property
    def wheel_angles_rad(self) -> tuple[float, ...]:
        """Bearing of each wheel [rad], counter-clockwise from forward."""
        first_rad, step_rad = math.radians(self.first_wheel_deg), math.tau / self.wheels
        return tuple([first_rad + k * step_rad for k in range(self.wheels)])

    def inverse(
        self,
        twist: Twist,
        joints_meas_rad: tuple[float, ...] = (),  # noqa: ARG002 - all drives share one signature
    ) -> ActuatorReference:
        """Return the wheel speeds for a body velocity; `joints_meas_rad` is not used."""
        v, turn, vy = twist.v_m_s, self.wheel_distance_m * twist.omega_rad_s, twist.vy_m_s
        r = self.wheel_radius_m
        return ActuatorReference(
            tuple([(vy * math.cos(a) - v * math.sin(a) + turn) / r for a in self.wheel_angles_rad]),
            (),
        )

    def forward(
        self,
        wheels_rad_s: tuple[float, ...],
        joints_rad: tuple[float, ...] = (),  # noqa: ARG002 - all drives share one signature
    ) -> Twist:
        """Return the velocity of `base` that fits the wheel speeds best (least squares)."""
        v = omega = vy = 0.0
        for a, speed in zip(self.wheel_angles_rad, wheels_rad_s, strict=True):
            v -= speed * math.sin(a)
            vy += speed * math.cos(a)
            omega += speed
        share_m = self.wheel_radius_m / self.wheels
        return Twist(2.0 * share_m * v, share_m * omega / self.wheel_distance_m, 2.0 * share_m * vy)
