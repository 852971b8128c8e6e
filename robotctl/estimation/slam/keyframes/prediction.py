"""Prediction of the motion to the next scan: by odometry, or by the motion so far."""

from __future__ import annotations

from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.keyframes.motion import (
    AFTER_A_BREAK,
    PredictedMotion,
    by_odometry,
)
from robotctl.estimation.slam.keyframes.robot_state import RobotState
from robotctl.model.geometry.se2 import SE2


class MotionPrediction:
    """Predicts the motion from one scan to the next."""

    def __init__(self, config: KeyframeConfig, robot: RobotState) -> None:
        self._wheels, self._robot = config.wheels, robot

    def step(self, stamp_ns: int, odometry: SE2 | None) -> PredictedMotion:
        """Return the motion since the last scan, with `base` in `odom` now; None: unknown."""
        robot = self._robot
        before, robot.odometry = robot.odometry, odometry
        robot.measured = None
        if odometry is not None and before is not None:
            robot.measured = by_odometry(before.inverse() @ odometry, self._wheels)
        robot.has_odometry = (
            robot.measured is not None and robot.trust.is_trusted and not robot.is_resumed
        )
        if robot.is_resumed:
            return AFTER_A_BREAK
        if robot.measured is not None and robot.trust.is_trusted:
            return robot.measured
        return robot.habit.predict(1e-9 * (stamp_ns - robot.place.stamp_ns))
