"""Car-like drive: Ackermann steering in front, differential gear behind."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from robotctl.errors import InvalidValue
from robotctl.model.drives.bends import bent, steered_rows
from robotctl.model.drives.steered import SteeredDrive
from robotctl.model.drives.wheels import (
    SidePair,
    require_offset,
    require_positive,
    require_steering,
)
from robotctl.model.geometry.twist import Twist

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


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
        require_positive(
            self,
            "wheelbase_m",
            "track_width_m",
            "wheel_radius_m",
            "steering_rate_max_rad_s",
            "counts_per_revolution",
        )
        require_steering(self.steering_max_rad)
        require_offset(self.steering_offset_rad, self.steering_max_rad)
        if self.min_turning_radius_m <= 0.5 * self.track_width_m:
            raise InvalidValue(
                "steering_max_rad",
                "puts the centre of rotation between the wheels: "
                f"{self.min_turning_radius_m:.3f} m from base, half the track is "
                f"{0.5 * self.track_width_m:.3f} m, found {self.steering_max_rad}",
                self.steering_max_rad,
            )

    def forward(self, wheels_rad_s: tuple[float, ...], joints_rad: tuple[float, ...]) -> Twist:
        """Return the velocity of `base`: v and v tan(s) / L.

        s is the angle of the virtual wheel, offset included.
        """
        v, s = wheels_rad_s[0] * self.wheel_radius_m, joints_rad[0] + self.steering_offset_rad
        return Twist(v, v * math.tan(s) / self.wheelbase_m)

    def forward_many(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return `forward` of many turns of the carrier and angles of the steering at once."""
        rolled, s = self.wheel_radius_m * rows[:, 0], rows[:, 1] + self.steering_offset_rad
        return bent(rolled, s, self.wheelbase_m)

    def inverse_many(self, moves: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return turns of the carrier and angles of the steering for many moves at once."""
        rows = steered_rows(moves, self.wheelbase_m, self.steering_offset_rad, front=False)
        rows[:, 0] /= self.wheel_radius_m
        return rows

    def linkage_angles_rad(self, steering_rad: float) -> SidePair:
        """Return the angles of the left and right front wheels [rad, positive left].

        Both wheels point along circles about one centre on the line of the rear axle:
        cot(outer) - cot(inner) = track / wheelbase, with the virtual wheel half-way between.
        """
        tangent = math.tan(steering_rad)
        offset = 0.5 * self.track_width_m * tangent
        length = self.wheelbase_m
        return SidePair(
            math.atan(length * tangent / (length - offset)),
            math.atan(length * tangent / (length + offset)),
        )

    def rear_wheel_speeds_rad_s(self, omega1_rad_s: float, steering_rad: float) -> SidePair:
        """Return the speeds that the differential gives the rear wheels [rad/s]."""
        share = 0.5 * self.track_width_m * math.tan(steering_rad) / self.wheelbase_m
        return SidePair(omega1_rad_s * (1.0 - share), omega1_rad_s * (1.0 + share))
