"""Car-like drive: Ackermann steering in front, differential gear behind."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from robotctl.errors import InvalidValue
from robotctl.model.drives.steered import SteeredDrive
from robotctl.model.drives.wheels import require_positive


@dataclass(frozen=True, slots=True)
class AckermannDrive(SteeredDrive):
    """Four wheels: front pair steered by an Ackermann linkage, rear pair on a differential gear.

    The steering angle is that of a virtual wheel in the middle of the front axle; the speed of
    the one motor is that of the differential's carrier, the mean of the rear wheels.

    Parameters
    ----------
    kind
        Always "ackermann".
    wheelbase_m
        Distance of the axles [m], > 0.
    track_width_m
        Distance of the left and right contact points, the same on both axles [m], > 0.
    wheel_radius_m
        Radius of the wheels [m], > 0.
    steering_max_rad
        Maximum angle of the virtual centre wheel [rad], in (0, pi/2), such that the centre of
        rotation stays outside of the track.
    steering_rate_max_rad_s
        Maximum steering rate [rad/s], > 0.
    counts_per_revolution
        Quadrature counts per turn of the carrier, > 0.
    steering_offset_rad
        Angle of the wheel at steering servo angle 0 [rad, positive left], smaller than
        steering_max_rad; from calibration.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    kind: Literal["ackermann"]
    wheelbase_m: float
    track_width_m: float
    wheel_radius_m: float
    steering_max_rad: float
    steering_rate_max_rad_s: float
    counts_per_revolution: int
    steering_offset_rad: float = 0.0

    def __post_init__(self) -> None:
        require_positive(self, "track_width_m")
        SteeredDrive.__post_init__(self)
        if self.min_turning_radius_m <= 0.5 * self.track_width_m:
            raise InvalidValue(
                "steering_max_rad",
                "puts the centre of rotation between the wheels: "
                f"{self.min_turning_radius_m:.3f} m from base, half the track is "
                f"{0.5 * self.track_width_m:.3f} m, found {self.steering_max_rad}",
                self.steering_max_rad,
            )
