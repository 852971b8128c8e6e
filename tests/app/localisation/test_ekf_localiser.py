"""The EKF localiser with a gyro against the true motion: slip, bias, and nothing counted twice."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from robotctl.app.localisation.ekf_localiser import EkfLocaliser
from robotctl.app.localisation.localiser import LocaliserInput
from robotctl.app.processes.robot import make_core
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.estimation.kalman.ekf import PoseEkf
from robotctl.estimation.kalman.ekf_config import EkfConfig
from robotctl.messages.control import ControlState, ImuFeedback, LoopStatistics
from robotctl.model.drives.motion import arc
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.pose_estimate import PoseEstimate
from robotctl.model.geometry.se2 import SE2
from robotctl.model.wall_map import WallMap

STEP_NS = 50_000_000
STEP_S = 0.05
SPEED_M_S = 0.3
CONFIG = load_robot(find_file("diff_drive"))
STATE = make_core(CONFIG, StackOptions("x", "")).snapshot(0, LoopStatistics())
FAR = WallMap(np.array([[50.0, -50.0, 50.0, 50.0]]))


class Drive:
    """A robot whose wheels do not tell all of its turning; its gyro has a bias and noise."""

    def __init__(self, *, gyro: bool, bias_rad_s: float = 0.0, corrects: bool = False) -> None:
        start = PoseEstimate(0, SE2(), np.diag([1e-4] * 3), LocalisationStatus.LOCALISED)
        self.ekf = PoseEkf(EkfConfig(gyro=gyro), start)
        self.localiser = EkfLocaliser(self.ekf, (), FAR)
        self.true, self.odometry = SE2(), SE2()
        self.now_ns = 0
        self._has_gyro, self._bias, self._corrects = gyro, bias_rad_s, corrects
        self._ahead_rad = self._corrected_rad = 0.0
        self._rng = np.random.default_rng(3)
        self.step(0.0, 0.0)

    def step(self, omega_rad_s: float, wheels_rad_s: float) -> None:
        self.now_ns += STEP_NS
        length, true_rad = SPEED_M_S * STEP_S, omega_rad_s * STEP_S
        self.true = arc(self.true, length, true_rad)
        noise = self._rng.normal(0.0, 0.0013)
        ahead_rad = (omega_rad_s + self._bias + noise - wheels_rad_s) * STEP_S
        self._ahead_rad += ahead_rad
        counted_rad = wheels_rad_s * STEP_S
        if self._corrects:
            counted_rad += ahead_rad
            self._corrected_rad += ahead_rad
        self.odometry = arc(self.odometry, length, counted_rad)
        imu = ImuFeedback(
            self.now_ns, self.now_ns, (0.0, 0.0, omega_rad_s), (0.0, 0.0, 9.8), (0.0, 0.0, 1.0),
            ahead_rad=self._ahead_rad, corrected_rad=self._corrected_rad,
        )  # fmt: skip
        self.state = self.localiser.step(self._control(imu), LocaliserInput(), self.now_ns)

    def _control(self, imu: ImuFeedback) -> ControlState:
        pose = self.odometry
        return msgspec.structs.replace(
            STATE, stamp_ns=self.now_ns, x_m=pose.x_m, y_m=pose.y_m, theta_rad=pose.theta_rad,
            imu=imu if self._has_gyro else None,
        )  # fmt: skip

    def drive(self, seconds: float, slip: float = 1.0) -> None:
        """Drive a slalom; the wheels say `slip` times its turning."""
        for n in range(round(seconds / STEP_S)):
            omega = 0.8 * math.sin(n * STEP_S)
            self.step(omega, slip * omega)

    @property
    def heading_error_rad(self) -> float:
        believed = self.state.T_world_odom @ self.odometry
        return abs(math.remainder(believed.theta_rad - self.true.theta_rad, math.tau))


@pytest.mark.parametrize("slip", [0.8, 1.25])
def test_wheels_that_slip_in_bends_lose_less_heading_with_a_gyro(slip: float) -> None:
    errors = []
    for gyro in (False, True):
        drive = Drive(gyro=gyro, corrects=gyro)
        drive.drive(3.0, slip)
        errors.append(drive.heading_error_rad)
    without, with_gyro = errors
    assert without > 0.25
    assert with_gyro < 0.1 * without


@pytest.mark.parametrize("bias_rad_s", [-0.015, 0.01])
def test_the_bias_that_is_left_is_a_state_and_found(bias_rad_s: float) -> None:
    drive = Drive(gyro=True, bias_rad_s=bias_rad_s)
    drive.drive(40.0)
    assert drive.ekf.x[5] == pytest.approx(bias_rad_s, abs=0.003)
    assert abs(drive.ekf.x[5] - bias_rad_s) < 3 * math.sqrt(drive.ekf.P[5, 5])


def test_what_odometry_has_taken_from_the_gyro_is_not_added_again() -> None:
    """The filter sees a gyro that agrees with the odometry: no innovation stands out."""
    drive = Drive(gyro=True, corrects=True)
    drive.drive(3.0, 1.25)
    assert drive.ekf.nis_per_dof < 0.5
    assert drive.ekf.x[5] == pytest.approx(0.0, abs=0.005)


def test_an_imu_that_comes_back_after_silence_tells_nothing_of_the_time_between() -> None:
    drive = Drive(gyro=True)
    drive.drive(2.0)
    drive._has_gyro = False
    drive.drive(2.0)
    drive._has_gyro, drive._ahead_rad = True, drive._ahead_rad + 2.0
    drive.step(0.0, 0.0)
    assert drive.heading_error_rad < 0.1
