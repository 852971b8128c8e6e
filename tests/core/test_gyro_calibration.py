"""The gyro's bias, measured anew on request; and an IMU while wheels turn in the air."""

import msgspec
import numpy as np
import pytest

from robotctl.estimation.inertial.tracker import GRAVITY_M_S2, STILL_RAD_S
from robotctl.messages.control import AccelerometerFeedback, Arm, GyroFeedback, SafetyState
from robotctl.messages.faults import FaultCode
from robotctl.messages.procedures import CalibrateGyro, CancelProcedure, MotorTest, Outcome
from robotctl.model.sensors.imu import ImuConfig
from tests.core import robot_double as double

SECOND_NS = 1_000_000_000
TAKES_TICKS = 600
BIAS = np.array([0.012, -0.02, 0.031])
SIGMA_RAD_S = 0.004
CHANGE_RAD_S = 0.05


class Sensing(double.RobotDouble):
    """A robot with an IMU that reads its bias and noise, 50 times a second, wherever it stands."""

    def __init__(self):
        super().__init__()
        self.core = double.make_core(imu=ImuConfig(enabled=True))
        self.bias = BIAS.copy()
        self.rng = np.random.default_rng(3)
        self.mute_imu = False
        self.felt_ns = 0
        self.ticks(400)

    def _feedback(self):
        feedback = super()._feedback()
        if self.mute_imu or self.now_ns < self.felt_ns + 20_000_000:
            return feedback
        self.felt_ns = self.now_ns
        rate = self.bias + self.rng.normal(0.0, SIGMA_RAD_S, 3)
        return msgspec.structs.replace(
            feedback,
            gyro=GyroFeedback(self.now_ns, *rate.tolist()),
            accelerometer=AccelerometerFeedback(self.now_ns, 0.0, 0.0, GRAVITY_M_S2),
        )

    def calibrate(self, request_id=5):
        self.tick(CalibrateGyro(self.now_ns, request_id))

    @property
    def procedure(self):
        return self.snapshot().procedure

    @property
    def known(self):
        return np.array(self.snapshot().imu.bias_rad_s)


def test_a_bias_that_has_changed_is_found_and_applied():
    robot = Sensing()
    assert robot.known == pytest.approx(BIAS, abs=0.002)
    robot.bias = BIAS + np.array([0.0, 0.0, CHANGE_RAD_S])
    robot.ticks(1000)
    assert robot.known == pytest.approx(BIAS, abs=0.002), "by itself it learns no such change"
    robot.calibrate()
    robot.ticks(TAKES_TICKS // 2)
    assert robot.procedure.outcome is Outcome.RUNNING
    assert robot.procedure.progress == pytest.approx(0.5, abs=0.01)
    assert robot.known == pytest.approx(BIAS, abs=0.002), "not before it is done"
    robot.ticks(TAKES_TICKS // 2)
    assert (robot.procedure.outcome, robot.procedure.progress) == (Outcome.DONE, 1.0)
    standard_error = SIGMA_RAD_S / np.sqrt(150)
    robot.ticks(4)
    assert robot.known == pytest.approx(robot.bias, abs=4.0 * standard_error)
    assert robot.state is SafetyState.STANDBY


def turned(robot):
    robot.bias = robot.bias + np.array([0.0, 0.0, 2.0 * STILL_RAD_S])


def rolled(robot):
    robot.speeds = [2.0, 2.0]


def silent(robot):
    robot.mute_imu = True


def armed(robot):
    robot.arm()


@pytest.mark.parametrize(
    ("what", "word"),
    [(turned, "turned"), (rolled, "wheels"), (silent, "readings"), (armed, "arm")],
)
def test_what_disturbs_it_makes_it_fail_and_changes_nothing(what, word):
    robot = Sensing()
    before = robot.core.motion.imu.bias_rad_s
    robot.calibrate()
    robot.ticks(100)
    what(robot)
    robot.ticks(TAKES_TICKS)
    assert robot.procedure.outcome in {Outcome.FAILED, Outcome.CANCELLED}
    assert word in robot.procedure.text
    assert robot.core.motion.imu.bias_rad_s == pytest.approx(before, abs=0.003)


def test_a_gyro_that_reads_too_much_for_a_bias_is_reported():
    robot = Sensing()
    robot.bias = np.array([0.0, 0.2, 0.0])
    robot.calibrate()
    robot.ticks(TAKES_TICKS)
    assert robot.procedure.outcome is Outcome.FAILED
    assert "at most 0.1" in robot.procedure.text


def test_it_can_be_taken_back_and_begun_again():
    robot = Sensing()
    robot.bias = BIAS + np.array([0.0, CHANGE_RAD_S, 0.0])
    robot.calibrate()
    robot.ticks(300)
    robot.tick(CancelProcedure(robot.now_ns, 5))
    assert robot.procedure.outcome is Outcome.CANCELLED
    robot.ticks(TAKES_TICKS)
    assert robot.known == pytest.approx(BIAS, abs=0.003)
    robot.calibrate(5)
    assert robot.procedure.outcome is Outcome.CANCELLED, "the same request, late"
    robot.calibrate(6)
    robot.ticks(TAKES_TICKS + 4)
    assert robot.known == pytest.approx(robot.bias, abs=0.002)


def test_it_needs_a_disarmed_robot_at_rest_with_a_gyro():
    robot = Sensing()
    robot.tick(Arm(robot.now_ns, 1, arm=True))
    robot.calibrate()
    assert robot.procedure.outcome is Outcome.REFUSED
    robot = Sensing()
    robot.speeds = [4.0, 4.0]
    robot.ticks(20)
    robot.calibrate()
    assert (robot.procedure.outcome, robot.procedure.text) == (Outcome.REFUSED, "the wheels turn")
    plain = double.RobotDouble()
    plain.ticks(double.WARM_TICKS)
    plain.tick(CalibrateGyro(plain.now_ns, 5))
    assert plain.snapshot().procedure.outcome is Outcome.REFUSED


def test_a_wheel_in_the_air_is_no_fault_in_a_motor_test_but_is_one_of_an_armed_robot():
    robot = Sensing()
    for _ in range(400):
        robot.tick(MotorTest(robot.now_ns, robot.now_ns + SECOND_NS, 9, 0, 0.15, 2 * SECOND_NS))
    robot.ticks(4)
    assert robot.procedure.outcome is Outcome.DONE, robot.procedure.text
    robot.ticks(200)
    robot.arm()
    robot.ticks(400, (0.0, 1.5))
    assert robot.core.machine.fault is not None
    assert robot.core.machine.fault.code in {FaultCode.GYRO_CONTRADICTS, FaultCode.WHEELS_SLIP}
