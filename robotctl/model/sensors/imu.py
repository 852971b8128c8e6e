"""An inertial measurement unit: whether there is one, and its mount."""

from __future__ import annotations

import math
from dataclasses import dataclass

from robotctl.errors import InvalidValue


@dataclass(frozen=True, slots=True)
class ImuConfig:
    """The table `[imu]` of a robot's file.

    Parameters
    ----------
    enabled
        Whether the robot has an IMU (CAN node 4), without which it does not arm.
    x_m, y_m
        Position of the IMU in `base` [m].
    yaw_deg
        Direction of its x axis in `base`, 0 forward, 90 left [deg]; its z axis points up.
    tilt_max_deg
        Tilt from upright beyond which the robot stops, 5 to 60 [deg].

    Raises
    ------
    ValueError
        If a number is not finite or not in its range.
    """

    enabled: bool = False
    x_m: float = 0.0
    y_m: float = 0.0
    yaw_deg: float = 0.0
    tilt_max_deg: float = 20.0

    def __post_init__(self) -> None:
        for key in ("x_m", "y_m", "yaw_deg"):
            value = getattr(self, key)
            if not math.isfinite(value):
                raise InvalidValue(key, f"must be finite, not {value}", value)
        if not 5.0 <= self.tilt_max_deg <= 60.0:
            raise InvalidValue(
                "tilt_max_deg", f"must be 5 to 60, not {self.tilt_max_deg:g}", self.tilt_max_deg
            )
