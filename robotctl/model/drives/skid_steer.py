"""Skid steer: four or six wheels, a motor each, that turn the robot by slipping sideways."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Final, Literal

from robotctl.errors import InvalidValue
from robotctl.model.drives.linear import LinearDrive
from robotctl.model.drives.wheels import POSITIVE, ActuatorReference, require_positive
from robotctl.model.geometry.twist import Twist

SLIP_FACTORS: Final = (1.0, 5.0)
"""Minimum and maximum ratio of effective to geometric track width."""


@dataclass(frozen=True, slots=True)
class SkidSteerDrive(LinearDrive):
    """Two or three driven wheels on each side; turns on the spot.

    The wheels of a side turn alike. Since all of them slide sideways in a turn, the robot turns as
    a differential drive whose wheels stand `slip_factor` times as far apart would (the lateral
    distance of the centres of rotation of both sides, A. Mandow et al., "Experimental kinematics
    for wheeled skid-steer mobile robots", IROS 2007). The factor depends on floor and load, so it
    comes from calibration; where the floor changes, the turning rate is off by its ratio.

    Parameters
    ----------
    kind
        Always "skid_steer".
    track_width_m
        Distance of the left and right contact points [m], > 0.
    wheelbase_m
        Distance of the foremost and the rearmost axle [m], > 0.
    wheel_radius_m
        Radius of the wheels [m], > 0.
    counts_per_revolution
        Quadrature counts per turn of a wheel, > 0.
    wheels_per_side
        Wheels on each side, 2 or 3.
    slip_factor
        Effective over geometric track width, in [1, 5]; from calibration.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    kind: Literal["skid_steer"]
    track_width_m: float
    wheelbase_m: float
    wheel_radius_m: float
    counts_per_revolution: int
    wheels_per_side: Literal[2, 3] = 2
    slip_factor: float = 1.5

    calibrated: ClassVar[Mapping[str, tuple[float, float]]] = {
        "wheel_radius_m": POSITIVE,
        "slip_factor": SLIP_FACTORS,
    }

    def __post_init__(self) -> None:
        require_positive(
            self, "track_width_m", "wheelbase_m", "wheel_radius_m", "counts_per_revolution"
        )
        if not SLIP_FACTORS[0] <= self.slip_factor <= SLIP_FACTORS[1]:
            raise InvalidValue(
                "slip_factor",
                f"must be between 1 and 5, found {self.slip_factor}",
                self.slip_factor,
            )

    @property
    def wheel_names(self) -> tuple[str, ...]:
        """Names of the wheels, axle by axle from the front, the left one first."""
        axles = ("front", "middle", "rear") if self.wheels_per_side == 3 else ("front", "rear")
        return tuple(f"{axle}_{side}" for axle in axles for side in ("left", "right"))

    @property
    def wheel_radii_m(self) -> tuple[float, ...]:
        """Radius of each wheel [m]."""
        return (self.wheel_radius_m,) * (2 * self.wheels_per_side)

    @property
    def effective_track_width_m(self) -> float:
        """Track width of the differential drive that turns alike [m]."""
        return self.slip_factor * self.track_width_m

    def inverse(
        self,
        twist: Twist,
        joints_meas_rad: tuple[float, ...] = (),  # noqa: ARG002 - all drives share one signature
    ) -> ActuatorReference:
        """Return the wheel speeds for a body velocity; `joints_meas_rad` is not used."""
        difference = 0.5 * self.effective_track_width_m * twist.omega_rad_s
        left_rad_s = (twist.v_m_s - difference) / self.wheel_radius_m
        right_rad_s = (twist.v_m_s + difference) / self.wheel_radius_m
        return ActuatorReference((left_rad_s, right_rad_s) * self.wheels_per_side, ())

    def forward(
        self,
        wheels_rad_s: tuple[float, ...],
        joints_rad: tuple[float, ...] = (),  # noqa: ARG002 - all drives share one signature
    ) -> Twist:
        """Return the velocity of `base` for the mean speed of each side; no joints."""
        share_m = self.wheel_radius_m / self.wheels_per_side
        left_m_s = share_m * math.fsum(wheels_rad_s[0::2])
        right_m_s = share_m * math.fsum(wheels_rad_s[1::2])
        return Twist(
            0.5 * (left_m_s + right_m_s), (right_m_s - left_m_s) / self.effective_track_width_m
        )
