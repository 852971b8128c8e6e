"""Kinematics of drives with one steered axle: the path bends by L / tan(s) about the rear axle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

from robotctl.model.drives.wheels import (
    POSITIVE,
    ActuatorReference,
    offsets_near,
    steering_angle_rad,
    within_linkage,
)
from robotctl.model.geometry.twist import Twist


class SteeredDrive:
    """One motor and one steering servo; `base` is in the middle of the rear axle."""

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

    @property
    def calibrated(self) -> Mapping[str, tuple[float, float]]:
        """Keys that calibration of the odometry sets, with the least and greatest value of each."""
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

    def wheel_speed_m_s(self, v_m_s: float, steering_rad: float) -> float:  # noqa: ARG002
        """Return the ground speed of the driven wheel for a speed of `base` [m/s]."""
        return v_m_s

    def turning_radius_m(self, steering_rad: float) -> float:
        """Return the radius L / tan(s) of the path of `base` [m]: positive left, inf at 0."""
        return self.wheelbase_m / math.tan(steering_rad) if steering_rad != 0.0 else math.inf
