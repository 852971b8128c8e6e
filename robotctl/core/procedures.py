"""The procedures of a disarmed robot: one calibration of the gyro, or one test of a motor."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotctl.control.pwm import PwmConfig
from robotctl.core.motion import EncoderMotion
from robotctl.core.motor_test import MotorTesting, Surroundings
from robotctl.estimation.inertial.gyro_calibration import LEAST_READINGS, GyroCalibration
from robotctl.messages.procedures import CalibrateGyro, MotorTest, Outcome, Procedure
from robotctl.model.drives.drives import Drive

if TYPE_CHECKING:
    from robotctl.safety.plausibility_config import PlausibilityConfig


class Procedures:
    """The one that is under way, and how the last one ended.

    Parameters
    ----------
    drive
        The wheels.
    pwm
        Their bridges.
    plausibility
        Has the constant of their motors.
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
        self, drive: Drive, pwm: PwmConfig, plausibility: PlausibilityConfig, period_ns: int
    ) -> None:
        self.latest = Procedure()
        self.test: MotorTesting | None = None
        self.surroundings = Surroundings()
        self._calibration: GyroCalibration | None = None
        self._gyro_ns = 0
        self._drive = drive
        self._pwm = pwm
        self._period_s = period_ns * 1e-9
        self._back_emf_v_s_rad = plausibility.back_emf_v_s_rad

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

    def begin_test(self, request: MotorTest, now_ns: int) -> None:
        """Begin to turn a wheel."""
        radius_m = self._drive.wheel_radii_m[request.wheel]
        self.test = MotorTesting(request, radius_m, self._back_emf_v_s_rad, self._pwm, now_ns)
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
        self,
        speeds_rad_s: tuple[float, ...],
        supply_v: float,
        now_ns: int,
    ) -> tuple[float, float] | None:
        """Return the duties of the wheels under test; None if the test is over.

        Parameters
        ----------
        speeds_rad_s
            Of the wheels [rad/s].
        supply_v
            Of the bridges [V].
        now_ns
            The time [ns].
        """
        test = self.test
        if test is None:
            return None
        wheel = test.request.wheel
        if why := test.failure(speeds_rad_s[wheel], now_ns) or self.surroundings.obstacle:
            self.end(Outcome.FAILED, why)
            return None
        self._tell(test.progress(now_ns))
        if self.latest.progress >= 1.0:
            name = self._drive.wheel_names[wheel]
            self.end(Outcome.DONE, f"{name} wheel: up to {test.fastest_rad_s:+.1f} rad/s")
            return None
        duty = test.duty(supply_v, self._period_s)
        return (duty, 0.0) if wheel == 0 else (0.0, duty)

    def _tell(self, progress: float) -> None:
        """Keep how far it is."""
        self.latest = Procedure(self.latest.request_id, Outcome.RUNNING, progress)
