"""The motion by encoders and IMU: speeds, odometry, the steering angle and attitude."""

from __future__ import annotations

from typing import Final

import msgspec

from robotctl.control.wheels import WheelControl
from robotctl.core.wheel_motion import WheelMotion
from robotctl.estimation.inertial.tracker import InertialTracker
from robotctl.estimation.odometry.odometry import Odometry
from robotctl.messages.actuators import ActuatorFeedback
from robotctl.messages.control import Feedback, ImuFeedback
from robotctl.model.drives.drives import Drive
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.model.sensors.imu import ImuConfig

_REST_M_S: Final = 0.02
_REST_RAD_S: Final = 0.1


class EncoderMotion:
    """Present estimates of wheels, odometry and IMU.

    Where there is an IMU, odometry turns by its gyro: what wheels miss as they slip is not lost.

    Parameters
    ----------
    drive, wheels
        Kinematics, and the loops whose estimators see the positions.
    pose_odom_base
        Where odometry starts.
    imu
        Mounting of the IMU, if there is one.

    Attributes
    ----------
    odometry
        Pose and distance.
    twist
        Measured velocity of `base`.
    speeds_rad_s, angles_rad
        Speed [rad/s] and unwrapped angle [rad] of each driven wheel.
    joints_rad
        Measured angle of each joint [rad].
    imu
        The newest of the IMU; None on a robot without one.
    epoch_ns
        When the frame `odom` began: the first step, or the last restart of the drive since [ns].
    """

    def __init__(
        self,
        drive: Drive,
        wheels: tuple[WheelControl, ...],
        pose_odom_base: SE2,
        imu: ImuConfig,
    ) -> None:
        self.odometry = Odometry(drive, pose_odom_base)
        self.twist = Twist(0.0, 0.0)
        self.joints_rad = (0.0,) * len(drive.joint_names)
        self.epoch_ns = 0
        self.imu: ImuFeedback | None = None
        self._inertial = InertialTracker(imu) if imu.enabled else None
        self._drive = drive
        self._wheels = wheels
        self._estimators = tuple(wheel.estimator for wheel in wheels)
        self.speeds_rad_s = self.angles_rad = (0.0,) * len(wheels)
        self._motions = tuple(WheelMotion(estimator) for estimator in self._estimators)

    @property
    def jumps(self) -> int:
        """Number of impossible jumps of the counts so far."""
        return sum([estimator.jumps for estimator in self._estimators])

    @property
    def pose_odom_base(self) -> SE2:
        """Pose of odometry."""
        return self.odometry.pose_odom_base

    @property
    def is_at_rest(self) -> bool:
        """Whether the wheels stand, up to an encoder that flickers between two counts."""
        twist = self.twist
        return twist.speed_m_s < _REST_M_S and abs(twist.omega_rad_s) < _REST_RAD_S

    def take_bias(self, bias_rad_s: tuple[float, float, float], readings: int) -> None:
        """Take a bias of the gyro that was measured [rad/s], the mean of so many readings."""
        if self._inertial is not None:
            self._inertial.take_bias(bias_rad_s, readings)

    def update(self, feedback: Feedback) -> Feedback:
        """Take the feedback; return it without positions of another time."""
        actuators = self._turn(feedback.actuators)
        if actuators is not feedback.actuators:
            feedback = msgspec.structs.replace(feedback, actuators=actuators)
        if self._inertial is not None:
            self._feel(self._inertial, feedback)
        return feedback

    def _feel(self, inertial: InertialTracker, feedback: Feedback) -> None:
        """Track the attitude, and turn odometry by rotation that the wheels did not show."""
        gyro, accelerometer, odometry = feedback.gyro, feedback.accelerometer, self.odometry
        turn_rad = inertial.update(gyro, accelerometer, self.twist.v_m_s, odometry.turned_rad)
        if turn_rad != 0.0:
            odometry.correct_heading(turn_rad)
        self.imu = inertial.latest

    def restart(self, now_ns: int) -> None:
        """Restart with the next counts: the drive's have restarted. The pose stays."""
        for motion in self._motions:
            motion.restart()
        self.odometry.reset((0.0,) * len(self._wheels))
        self.epoch_ns = now_ns

    def _turn(self, reports: tuple[ActuatorFeedback, ...]) -> tuple[ActuatorFeedback, ...]:
        """Update velocities and odometry; return the reports without motions of another time."""
        if not reports:
            return reports
        n = len(self._motions)
        if self.joints_rad:
            self.joints_rad = tuple([report.angle_rad or 0.0 for report in reports[n:]])
        kept: list[ActuatorFeedback] = []
        moves = differs = False
        for motion, report in zip(self._motions, reports, strict=False):
            used, moved = motion.take(report)
            kept.append(used)
            moves = moves or moved
            differs = differs or used is not report
        if moves:
            joints_rad, estimators = self.joints_rad, self._estimators
            self.angles_rad = tuple([each.position_rad for each in estimators])
            self.speeds_rad_s = tuple([each.velocity_rad_s for each in estimators])
            self.odometry.update(self.angles_rad, joints_rad)
            self.twist = self._drive.forward(self.speeds_rad_s, joints_rad)
        return (*kept, *reports[n:]) if differs else reports
