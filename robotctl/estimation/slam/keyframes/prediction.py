"""Prediction of the motion to the next scan: by odometry, or by the motion so far."""

from __future__ import annotations

from robotctl.estimation.slam.keyframes.motion import (
    AFTER_A_BREAK,
    PredictedMotion,
    by_odometry,
    by_velocity,
)
from robotctl.estimation.slam.keyframes.robot_state import RobotState
from robotctl.estimation.slam_config import KeyframeConfig
from robotctl.model.geometry.se2 import SE2


class MotionPrediction:
    """Predicts the motion from one scan to the next."""

    def __init__(self, config: KeyframeConfig, robot: RobotState) -> None:
        self._wheels, self._most = config.wheels, config.tuning.tracking.velocity_factor
        self._robot = robot

    def step(self, stamp_ns: int, odometry: SE2 | None) -> PredictedMotion:
        """Return the motion since the last scan, with `base` in `odom` now; None: unknown."""
        robot = self._robot
        before, robot.odometry = robot.odometry, odometry
        robot.has_odometry = odometry is not None and before is not None and not robot.is_resumed
        if robot.is_resumed:
            return AFTER_A_BREAK
        if odometry is not None and before is not None:
            return by_odometry(before.inverse() @ odometry, self._wheels)
        since_s = 1e-9 * (stamp_ns - robot.place.stamp_ns)
        return by_velocity(robot.last_motion, robot.last_motion_s, since_s, self._most)
