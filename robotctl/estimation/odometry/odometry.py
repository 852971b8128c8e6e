"""Odometry: the pose that follows from wheel angles alone."""

from __future__ import annotations

from robotctl.model.drives.drives import Drive
from robotctl.model.drives.motion import arc
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2


class Odometry:
    """Dead reckoning of `base` in `odom` from wheel angles and steering angle.

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
        self._angle1_rad = 0.0
        self._angle2_rad = 0.0

    def reset(self, angle1_rad: float, angle2_rad: float) -> None:
        """Take the present wheel angles [rad] as a new zero; the pose stays."""
        self._angle1_rad = angle1_rad
        self._angle2_rad = angle2_rad

    def update(self, angle1_rad: float, angle2_rad: float, steering_rad: float) -> None:
        """Move the pose by the change of the wheel angles [rad] at the steering angle [rad]."""
        turn1_rad = angle1_rad - self._angle1_rad
        turn2_rad = angle2_rad - self._angle2_rad
        if turn1_rad == 0.0 and turn2_rad == 0.0:
            return
        self._angle1_rad = angle1_rad
        self._angle2_rad = angle2_rad
        # forward() is linear in the wheel speeds, so increments give the increment of the pose.
        moved_m, turned_rad = self._drive.forward(turn1_rad, turn2_rad, steering_rad)
        self.pose_odom_base = arc(self.pose_odom_base, moved_m, turned_rad)
        self.distance_m += abs(moved_m)
        self.turned_rad += turned_rad

    def correct_heading(self, turn_rad: float) -> None:
        """Turn the pose by an angle that the wheels did not show [rad]."""
        pose = self.pose_odom_base
        self.pose_odom_base = SE2(pose.x_m, pose.y_m, wrap_angle(pose.theta_rad + turn_rad))
