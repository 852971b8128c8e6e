"""Odometry: the pose that follows from wheel angles alone."""

from __future__ import annotations

import math
from operator import sub

from robotctl.model.drives.drives import Drive
from robotctl.model.drives.motion import arc
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2


class Odometry:
    """Dead reckoning of `base` in `odom` from the angles of wheels and joints.

    Each increment is an exact arc, so the error does not depend on the rate; it assumes rolling
    without slip and grows without bound.

    Parameters
    ----------
    drive
        Kinematics.
    pose_odom_base
        Pose at the start.
    """

    def __init__(self, drive: Drive, pose_odom_base: SE2) -> None:
        self.pose_odom_base = pose_odom_base
        self.distance_m = 0.0
        self.turned_rad = 0.0
        """Sum of all turning by the wheels [rad]."""
        self._drive = drive
        self._angles_rad = (0.0,) * len(drive.wheel_names)

    def reset(self, angles_rad: tuple[float, ...]) -> None:
        """Take the present wheel angles [rad] as a new zero; the pose stays."""
        self._angles_rad = angles_rad

    def update(self, angles_rad: tuple[float, ...], joints_rad: tuple[float, ...]) -> None:
        """Move the pose by the change of the wheel angles [rad] with joints at [rad]."""
        if angles_rad == self._angles_rad:
            return
        turns_rad = tuple(map(sub, angles_rad, self._angles_rad))
        self._angles_rad = angles_rad
        # forward() is linear in the wheel speeds, so increments give the increment of the pose.
        moved_m, turned_rad, sideways_m = self._drive.forward(turns_rad, joints_rad)
        self.pose_odom_base = arc(self.pose_odom_base, moved_m, turned_rad, sideways_m)
        self.distance_m += math.hypot(moved_m, sideways_m) if sideways_m else abs(moved_m)
        self.turned_rad += turned_rad

    def correct_heading(self, turn_rad: float) -> None:
        """Turn the pose by an angle that the wheels did not show [rad]."""
        pose = self.pose_odom_base
        self.pose_odom_base = SE2(pose.x_m, pose.y_m, wrap_angle(pose.theta_rad + turn_rad))
