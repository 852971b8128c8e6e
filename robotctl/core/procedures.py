"""The procedures of a disarmed robot: one calibration of the gyro, or one test of a motor."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotctl.control.pwm import PwmConfig
from robotctl.core.motion import EncoderMotion
from robotctl.core.motor_test import (
    FASTEST_M_S,
    Effort,
    MotorTestClearance,
    MotorTesting,
    SpeedEffort,
    VoltageEffort,
)
from robotctl.estimation.inertial.gyro_calibration import LEAST_READINGS, GyroCalibration
from robotctl.messages.procedures import CalibrateGyro, MotorTest, Outcome, Procedure
from robotctl.model.actuators import Actuator, Takes
from robotctl.model.drives.drives import Drive

if TYPE_CHECKING:
    from robotctl.safety.plausibility_config import PlausibilityConfig


class Procedures:
    """The one that is under way, and how the last one ended.

    Parameters
    ----------
    drive, actuators
        Kinematics, and its wheels and joints.
    pwm
        Bridges of the wheels that take a duty.
    plausibility
        Constant of their motors.
    period_ns
        Control period [ns].

    Attributes
    ----------
    latest
        State of the last one.
    test
        The test of a motor that is under way.
    surroundings
        What keeps a motor from being tested.
    """

    def __init__(
        self,
        drive: Drive,
        actuators: tuple[Actuator, ...],
        pwm: PwmConfig,
        plausibility: PlausibilityConfig,
        period_ns: int,
    ) -> None:
        self.latest = Procedure()
        self.test: MotorTesting | None = None
        self.surroundings = MotorTestClearance()
        self._calibration: GyroCalibration | None = None
        self._gyro_ns = 0
        self._held_rad: tuple[float, ...] = ()
        self._drive = drive
        self._actuators = actuators
        self._pwm = pwm
        self._period_s = period_ns * 1e-9
        self._plausibility = plausibility

    def is_known(self, request: CalibrateGyro | MotorTest) -> bool:
        """Say whether a request is that of the last procedure; a test under way goes on then."""
        if request.request_id != self.latest.request_id:
            return False
        if self.test is not None and isinstance(request, MotorTest):
            self.test.renew(request)
        return True

    def refuse(self, request: CalibrateGyro | MotorTest, why: str) -> None:
        """Do not begin."""
        self.latest = Procedure(request.request_id, Outcome.REFUSED, 0.0, why)

    def calibrate(self, request: CalibrateGyro, now_ns: int) -> None:
        """Begin to measure the gyro's bias."""
        self._calibration = GyroCalibration(now_ns)
        self.latest = Procedure(request.request_id, Outcome.RUNNING)

    def begin_test(self, request: MotorTest, joints_rad: tuple[float, ...], now_ns: int) -> None:
        """Begin to turn a wheel; joints stay at their present angles [rad]."""
        bound_rad_s = FASTEST_M_S / self._drive.wheel_radii_m[request.wheel]
        if self._actuators[request.wheel].takes is Takes.DUTY:
            effort: Effort = VoltageEffort(self._plausibility.motor[1] * bound_rad_s, self._pwm)
        else:
            effort = SpeedEffort(bound_rad_s)
        self.test = MotorTesting(request, bound_rad_s, effort, now_ns)
        self._held_rad = joints_rad
        self.latest = Procedure(request.request_id, Outcome.RUNNING)

    def end(self, outcome: Outcome, text: str) -> None:
        """End what is under way, if anything is."""
        if self.latest.outcome is Outcome.RUNNING:
            progress = 1.0 if outcome is Outcome.DONE else self.latest.progress
            self.latest = Procedure(self.latest.request_id, outcome, progress, text)
        self.test = self._calibration = None

    def measure(self, motion: EncoderMotion, now_ns: int) -> None:
        """Take the newest reading of the gyro, and the result at the end."""
        calibration, imu = self._calibration, motion.imu
        if calibration is None or imu is None:
            return
        if imu.gyro_stamp_ns != self._gyro_ns:
            self._gyro_ns = imu.gyro_stamp_ns
            why = calibration.take(imu.rate_rad_s)
            if not motion.is_at_rest:
                why = "the wheels turned"
            if why:
                self.end(Outcome.FAILED, why)
                return
        self._tell(calibration.progress(now_ns))
        if self.latest.progress >= 1.0 and calibration.readings < LEAST_READINGS:
            self.end(Outcome.FAILED, f"the gyro gave {calibration.readings} readings only")
        elif self.latest.progress >= 1.0:
            motion.take_bias(calibration.bias_rad_s, calibration.readings)
            words = ", ".join(f"{each:+.4f}" for each in calibration.bias_rad_s)
            self.end(Outcome.DONE, f"bias of the gyro: {words} rad/s")

    def turn(
        self, motion: EncoderMotion, supplies_v: tuple[float, ...], now_ns: int
    ) -> tuple[float, ...] | None:
        """Return the commands of all actuators during a test; None if the test is over.

        Parameters
        ----------
        motion
            Present motion.
        supplies_v
            Supply of each wheel's drive [V].
        now_ns
            The time [ns].
        """
        test = self.test
        if test is None:
            return None
        wheel = test.request.wheel
        if why := test.failure(motion.speeds_rad_s[wheel], now_ns) or self.surroundings.obstacle:
            self.end(Outcome.FAILED, why)
            return None
        self._tell(test.progress(now_ns))
        if self.latest.progress >= 1.0:
            name = self._drive.wheel_names[wheel]
            self.end(Outcome.DONE, f"{name} wheel: up to {test.fastest_rad_s:+.1f} rad/s")
            return None
        values = [0.0] * len(supplies_v)
        values[wheel] = test.step(supplies_v[wheel], self._period_s)
        return (*values, *self._held_rad)

    def _tell(self, progress: float) -> None:
        """Keep how far it is."""
        self.latest = Procedure(self.latest.request_id, Outcome.RUNNING, progress)
