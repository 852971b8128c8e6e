"""Tricycle with front or rear drive."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from robotctl.model.drives.steered import SteeredDrive
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

    def wheel_speed_m_s(self, v_m_s: float, steering_rad: float) -> float:
        """Return the ground speed of the driven wheel for a speed of `base` [m/s]."""
        return v_m_s / math.cos(steering_rad) if self.driven == "front" else v_m_s

    def forward(self, wheels_rad_s: tuple[float, ...], joints_rad: tuple[float, ...]) -> Twist:
        """Return the velocity of `base`.

        Front drive: v cos(s) and v sin(s) / L; rear drive: v and v tan(s) / L, with v the speed
        of the driven wheel and s its angle, offset included.
        """
        if self.driven == "rear":
            return SteeredDrive.forward(self, wheels_rad_s, joints_rad)
        v, s = wheels_rad_s[0] * self.wheel_radius_m, joints_rad[0] + self.steering_offset_rad
        return Twist(v * math.cos(s), v * math.sin(s) / self.wheelbase_m)

    def forward_many(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return `forward` of turns of the wheel and steering angles, (n, 2), as (n, 3)."""
        import numpy as np  # noqa: PLC0415 - the control process loads the drives, not numpy

        if self.driven == "rear":
            return SteeredDrive.forward_many(self, rows)
        rolled, s = self.wheel_radius_m * rows[:, 0], rows[:, 1] + self.steering_offset_rad
        turned = rolled * np.sin(s) / self.wheelbase_m
        return np.stack([rolled * np.cos(s), turned, np.zeros_like(rolled)], axis=1)

    def _rolled_m(
        self, d_m: NDArray[np.float64], steering_rad: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        import numpy as np  # noqa: PLC0415 - the control process loads the drives, not numpy

        return d_m / np.cos(steering_rad) if self.driven == "front" else d_m

    def front_turning_radius_m(self, steering_rad: float) -> float:
        """Return the radius L / sin(s) of the path of the front wheel [m]: inf at 0."""
        return self.wheelbase_m / math.sin(steering_rad) if steering_rad != 0.0 else math.inf
