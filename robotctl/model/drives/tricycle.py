"""Tricycle with front or rear drive."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from robotctl.model.drives.bends import bent, pivoted, steered_rows
from robotctl.model.drives.steered import SteeredDrive
from robotctl.model.drives.wheels import (
    require_offset,
    require_positive,
    require_steering,
)
from robotctl.model.geometry.twist import Twist

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class TricycleDrive(SteeredDrive):
    """One steered front wheel and two rear wheels; cannot turn on the spot.

    Parameters
    ----------
    kind
        Always "tricycle".
    driven
        "front": the motor turns the steered wheel, v_front = v / cos(s). "rear": it turns the
        rear axle through a differential, whose mean speed is v.
    wheelbase_m
        Distance from the rear axle to the front wheel, L [m], > 0.
    wheel_radius_m
        Radius of the driven wheel [m], > 0.
    steering_max_rad
        Maximum steering angle to either side [rad], in (0, pi/2).
    steering_rate_max_rad_s
        Maximum steering rate [rad/s], > 0.
    counts_per_revolution
        Quadrature counts per turn of the driven wheel, > 0.
    steering_offset_rad
        Angle of the wheel at steering servo angle 0 [rad, positive left], smaller than
        steering_max_rad; from calibration.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    kind: Literal["tricycle"]
    driven: Literal["front", "rear"]
    wheelbase_m: float
    wheel_radius_m: float
    steering_max_rad: float
    steering_rate_max_rad_s: float
    counts_per_revolution: int
    steering_offset_rad: float = 0.0

    def __post_init__(self) -> None:
        require_positive(
            self,
            "wheelbase_m",
            "wheel_radius_m",
            "steering_rate_max_rad_s",
            "counts_per_revolution",
        )
        require_steering(self.steering_max_rad)
        require_offset(self.steering_offset_rad, self.steering_max_rad)

    def wheel_speed_m_s(self, v_m_s: float, steering_rad: float) -> float:
        """Return the ground speed of the driven wheel for a speed of `base` [m/s]."""
        return v_m_s / math.cos(steering_rad) if self.driven == "front" else v_m_s

    def forward(self, wheels_rad_s: tuple[float, ...], joints_rad: tuple[float, ...]) -> Twist:
        """Return the velocity of `base`.

        Front drive: v cos(s) and v sin(s) / L; rear drive: v and v tan(s) / L, with v the speed
        of the driven wheel and s its angle, offset included.
        """
        v, s = wheels_rad_s[0] * self.wheel_radius_m, joints_rad[0] + self.steering_offset_rad
        if self.driven == "front":
            return Twist(v * math.cos(s), v * math.sin(s) / self.wheelbase_m)
        return Twist(v, v * math.tan(s) / self.wheelbase_m)

    def forward_many(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return `forward` of many turns of the wheel and angles of the steering at once."""
        rolled, s = self.wheel_radius_m * rows[:, 0], rows[:, 1] + self.steering_offset_rad
        if self.driven == "front":
            return pivoted(rolled, s, self.wheelbase_m)
        return bent(rolled, s, self.wheelbase_m)

    def inverse_many(self, moves: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return turns of the wheel and angles of the steering for many moves at once."""
        front = self.driven == "front"
        rows = steered_rows(moves, self.wheelbase_m, self.steering_offset_rad, front=front)
        rows[:, 0] /= self.wheel_radius_m
        return rows

    def front_turning_radius_m(self, steering_rad: float) -> float:
        """Return the radius L / sin(s) of the path of the front wheel [m]: inf at 0."""
        return self.wheelbase_m / math.sin(steering_rad) if steering_rad != 0.0 else math.inf
