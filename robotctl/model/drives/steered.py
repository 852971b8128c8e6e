"""Kinematics of drives with one steered axle: the path bends by L / tan(s) about the rear axle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

from robotctl.model.drives.wheels import (
    POSITIVE,
    ActuatorReference,
    offsets_near,
    require_offset,
    require_positive,
    require_steering,
    steering_angle_rad,
    within_linkage,
)
from robotctl.model.geometry.twist import Twist

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class SteeredDrive:
    """One motor and one steering servo; `base` is in the middle of the rear axle.

    Unless a subclass says otherwise, the motor drives the rear wheels.
    """

    __slots__ = ()

    wheelbase_m: float
    wheel_radius_m: float
    steering_max_rad: float
    steering_rate_max_rad_s: float
    steering_offset_rad: float

    degrees_of_freedom: ClassVar[int] = 3
    """Degrees of freedom of the pose in the plane: x, y, theta."""
    holonomic: ClassVar[bool] = False
    """Whether it moves sideways at once: it can neither do that nor turn on the spot."""
    steered: ClassVar[bool] = True
    wheel_names: ClassVar[tuple[str, ...]] = ("drive",)
    joint_names: ClassVar[tuple[str, ...]] = ("steering",)

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

    @property
    def calibrated(self) -> Mapping[str, tuple[float, float]]:
        """Keys that calibration of the odometry sets, with the minimum and maximum of each."""
        return {
            "wheel_radius_m": POSITIVE,
            "wheelbase_m": POSITIVE,
            "steering_offset_rad": offsets_near(self.steering_offset_rad, self.steering_max_rad),
        }

    @property
    def min_turning_radius_m(self) -> float:
        """Minimum radius L / tan(s) of the path of `base` to both sides [m]."""
        reach_rad = self.steering_max_rad - abs(self.steering_offset_rad)
        return self.wheelbase_m / math.tan(reach_rad)

    @property
    def joint_max_rad(self) -> tuple[float, ...]:
        """Maximum steering angle to either side [rad]."""
        return (self.steering_max_rad,)

    @property
    def joint_rate_max_rad_s(self) -> tuple[float, ...]:
        """Maximum steering rate [rad/s]."""
        return (self.steering_rate_max_rad_s,)

    @property
    def wheel_radii_m(self) -> tuple[float, ...]:
        """Radius of the wheel with the encoder [m]."""
        return (self.wheel_radius_m,)

    def inverse(
        self, twist: Twist, joints_meas_rad: tuple[float, ...] = (0.0,)
    ) -> ActuatorReference:
        """Return wheel speed and steering for a body velocity.

        A curvature out of reach is clamped and v is kept. v = 0 keeps the present steering
        `joints_meas_rad` [rad], within the linkage, since steering then does not turn the robot.
        """
        v_m_s = twist.v_m_s
        if v_m_s == 0.0:
            kept_rad = within_linkage(joints_meas_rad[0], self.steering_max_rad)
            return ActuatorReference((0.0,), (kept_rad,))
        steering_rad = steering_angle_rad(
            v_m_s,
            twist.omega_rad_s,
            self.wheelbase_m,
            self.steering_max_rad,
            self.steering_offset_rad,
        )
        v_wheel = self.wheel_speed_m_s(v_m_s, steering_rad + self.steering_offset_rad)
        return ActuatorReference((v_wheel / self.wheel_radius_m,), (steering_rad,))

    def forward(self, wheels_rad_s: tuple[float, ...], joints_rad: tuple[float, ...]) -> Twist:
        """Return the velocity of `base`: v and v tan(s) / L.

        s is the angle of the steered wheel, or of a car's virtual one, offset included.
        """
        v, s = wheels_rad_s[0] * self.wheel_radius_m, joints_rad[0] + self.steering_offset_rad
        return Twist(v, v * math.tan(s) / self.wheelbase_m)

    def forward_many(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return `forward` of turns of the wheel and steering angles, (n, 2), as (n, 3)."""
        import numpy as np  # noqa: PLC0415 - the control process loads the drives, not numpy

        rolled, s = self.wheel_radius_m * rows[:, 0], rows[:, 1] + self.steering_offset_rad
        turned = rolled * np.tan(s) / self.wheelbase_m
        return np.stack([rolled, turned, np.zeros_like(rolled)], axis=1)

    def inverse_many(self, moves: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return turns of the wheel and steering angles, (n, 2), for moves (n, 3).

        Without motion the servo stands at 0.
        """
        import numpy as np  # noqa: PLC0415 - the control process loads the drives, not numpy

        d, across = moves[:, 0], self.wheelbase_m * moves[:, 1]
        # backwards, wheel and turn change their signs, and the steering stands as it did
        s = np.arctan2(across * np.sign(d), np.abs(d))
        turns = self._rolled_m(d, s) / self.wheel_radius_m
        return np.stack([turns, np.where(d == 0.0, 0.0, s - self.steering_offset_rad)], axis=1)

    def _rolled_m(
        self,
        d_m: NDArray[np.float64],
        steering_rad: NDArray[np.float64],  # noqa: ARG002 - matters to a driven front wheel
    ) -> NDArray[np.float64]:
        """Return the distance rolled by the driven wheel for distances of `base` [m]."""
        return d_m

    def wheel_speed_m_s(self, v_m_s: float, steering_rad: float) -> float:  # noqa: ARG002
        """Return the ground speed of the driven wheel for a speed of `base` [m/s]."""
        return v_m_s

    def turning_radius_m(self, steering_rad: float) -> float:
        """Return the radius L / tan(s) of the path of `base` [m]: positive left, inf at 0."""
        return self.wheelbase_m / math.tan(steering_rad) if steering_rad != 0.0 else math.inf
