"""The motion by encoders and IMU: speeds, odometry, the steering angle and attitude."""

from __future__ import annotations

from typing import Final

import msgspec

from robotctl.control.wheel_loop import WheelLoop
from robotctl.estimation.inertial.tracker import InertialTracker
from robotctl.estimation.odometry.odometry import Odometry
from robotctl.messages.control import Feedback, ImuFeedback, WheelFeedback
from robotctl.model.drives.drives import Drive
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.model.sensors.imu import ImuConfig
from robotctl.safety.stale_frame_filter import Latch, LatchTimes

_REST_M_S: Final = 0.02
_REST_RAD_S: Final = 0.1


class EncoderMotion:
    """Present estimates of wheels, odometry and IMU.

    Where there is an IMU, odometry turns by its gyro: what wheels miss as they slip is not lost.

    Parameters
    ----------
    drive, wheels
        Kinematics, and the loops whose estimators see the counts.
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
    steering_rad
        Measured steering angle [rad].
    imu
        The newest of the IMU; None on a robot without one.
    epoch_ns
        When the frame `odom` began: the first step, or the last restart of the drive since [ns].
    """

    def __init__(
        self,
        drive: Drive,
        wheels: tuple[WheelLoop, ...],
        pose_odom_base: SE2,
        imu: ImuConfig,
    ) -> None:
        self.odometry = Odometry(drive, pose_odom_base)
        self.twist = Twist(0.0, 0.0)
        self.steering_rad = 0.0
        self.epoch_ns = 0
        self.imu: ImuFeedback | None = None
        self._inertial = InertialTracker(imu) if imu.enabled else None
        self._drive = drive
        self._wheels = wheels
        self._estimators = tuple(wheel.estimator for wheel in wheels)
        self._has_counts = False
        self._latches = LatchTimes()

    @property
    def speeds_rad_s(self) -> tuple[float, ...]:
        """Speed of each driven wheel [rad/s]."""
        return tuple([wheel.estimator.velocity_rad_s for wheel in self._wheels])

    @property
    def jumps(self) -> int:
        """Number of impossible jumps of the counts so far."""
        return sum([wheel.estimator.jumps for wheel in self._wheels])

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
        """Take the feedback; return it without counts of another time."""
        wheels = feedback.wheels
        latch = Latch.NEXT if wheels is None else self._latches.judge(wheels)
        if latch is Latch.HELD_BACK:
            wheels = None
            feedback = msgspec.structs.replace(feedback, wheels=None)
        if feedback.drive is not None:
            self.steering_rad = feedback.drive.steering_rad
        if wheels is not None:
            self._count(wheels, anew=latch is Latch.ANEW)
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
        self._has_counts = False
        self._latches.reset()
        self.odometry.reset((0.0,) * len(self._wheels))
        self.epoch_ns = now_ns

    def _count(self, wheels: WheelFeedback, *, anew: bool) -> None:
        """Update velocities and odometry; `anew`: after a gap of unknown length."""
        estimators = self._estimators
        if anew or not self._has_counts:
            self._begin_counts(wheels)
        # A robot with a single driven wheel has the first count alone.
        for estimator, count in zip(estimators, (wheels.count1, wheels.count2), strict=False):
            estimator.update(count, wheels.timestamp_us)
        joints_rad = (self.steering_rad,)
        self.odometry.update(tuple([each.position_rad for each in estimators]), joints_rad)
        self.twist = self._drive.forward(
            tuple([each.velocity_rad_s for each in estimators]), joints_rad
        )

    def _begin_counts(self, wheels: WheelFeedback) -> None:
        """Take counts for the first, or as going on after a gap."""
        counts = wheels.count1, wheels.count2
        for wheel, count in zip(self._wheels, counts, strict=False):
            if self._has_counts:
                wheel.estimator.resume(count, wheels.timestamp_us)
            else:
                wheel.estimator.reset(count, wheels.timestamp_us)
        self._has_counts = True
