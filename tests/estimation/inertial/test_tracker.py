"""Attitude, rise and slip by the IMU against closed forms and scipy's rotations."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robotctl.estimation.inertial.tracker import GRAVITY_M_S2, InertialTracker
from robotctl.messages.control import AccelerometerFeedback, GyroFeedback
from robotctl.model.sensors.imu import ImuConfig

STEP_S = 0.02
BIAS = (0.01, -0.02, 0.015)


class Carrier:
    """Moves a tracker on by readings; `wheels_rad` is what its wheels say of turning."""

    def __init__(self, **mount: float) -> None:
        self.tracker = InertialTracker(ImuConfig(enabled=True, **mount))
        self.now_ns = 1_000_000_000
        self.wheels_rad = 0.0
        self.corrected_rad = 0.0

    def step(self, rate=(0.0, 0.0, 0.0), force=(0.0, 0.0, GRAVITY_M_S2), v=0.0, wheels=None):
        self.now_ns += round(STEP_S * 1e9)
        self.wheels_rad += (rate[2] if wheels is None else wheels) * STEP_S
        gyro = GyroFeedback(self.now_ns, *(r + b for r, b in zip(rate, BIAS, strict=True)))
        accelerometer = AccelerometerFeedback(self.now_ns, *force)
        self.corrected_rad += self.tracker.update(gyro, accelerometer, v, self.wheels_rad)
        assert self.tracker.latest is not None
        return self.tracker.latest

    def rest(self, seconds=3.0):
        for _ in range(round(seconds / STEP_S)):
            imu = self.step()
        return imu


def test_before_both_sensors_have_spoken_nothing_is_known() -> None:
    tracker = InertialTracker(ImuConfig(enabled=True))
    assert tracker.latest is None
    tracker.update(GyroFeedback(10, 0.0, 0.0, 0.0), None, 0.0, 0.0)
    assert tracker.latest is None


def test_at_rest_the_bias_is_learned_and_the_robot_stands_upright() -> None:
    imu = Carrier().rest()
    assert imu.bias_rad_s == pytest.approx(BIAS)
    assert imu.tilt_rad == pytest.approx(0.0, abs=1e-3)
    assert imu.rise_m_s == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("roll_deg", [-25.0, 10.0, 50.0])
@pytest.mark.parametrize("pitch_deg", [-40.0, 0.0, 30.0])
def test_a_tilt_is_followed_by_the_gyro_and_kept_by_the_floor(roll_deg, pitch_deg) -> None:
    carrier, seconds = Carrier(), 0.6
    carrier.rest()
    steps = round(seconds / STEP_S)
    final = Rotation.from_euler("ZYX", [0.0, pitch_deg, roll_deg], degrees=True)
    rate = final.as_rotvec() / seconds  # a turn about one axis
    for n in range(1, steps + 1):
        attitude = Rotation.from_rotvec(rate * n * STEP_S)
        force = attitude.inv().apply([0.0, 0.0, GRAVITY_M_S2])
        imu = carrier.step(tuple(rate), tuple(force))
    turned = imu.roll_rad, imu.pitch_rad
    assert turned == pytest.approx((math.radians(roll_deg), math.radians(pitch_deg)), abs=0.03)
    for _ in range(300):
        imu = carrier.step((0.0, 0.0, 0.0), tuple(force))
    assert imu.roll_rad == pytest.approx(math.radians(roll_deg), abs=0.02)
    assert imu.pitch_rad == pytest.approx(math.radians(pitch_deg), abs=0.02)


def test_hard_braking_looks_like_no_slope() -> None:
    carrier = Carrier()
    carrier.rest()
    worst = 0.0
    for n in range(round(0.8 / 2.5 / STEP_S)):
        v = 0.8 - 2.5 * n * STEP_S
        worst = max(worst, carrier.step(force=(-2.5, 0.0, GRAVITY_M_S2), v=v).tilt_rad)
    assert math.degrees(worst) < 4.0


@pytest.mark.parametrize("mount", [(0.0, 0.0, 0.0), (0.2, -0.1, 90.0)])
def test_a_circle_that_does_not_end_looks_like_no_slope(mount) -> None:
    x_m, y_m, yaw_deg = mount
    carrier = Carrier(x_m=x_m, y_m=y_m, yaw_deg=yaw_deg)
    carrier.rest()
    v, omega = 0.8, 2.5
    x, y = -(omega**2) * x_m, v * omega - omega**2 * y_m
    c, s = math.cos(math.radians(yaw_deg)), math.sin(math.radians(yaw_deg))
    force = (c * x + s * y, -s * x + c * y, GRAVITY_M_S2)
    for _ in range(500):
        imu = carrier.step((0.0, 0.0, omega), force, v=v)
    assert math.degrees(imu.tilt_rad) < 1.0


def test_being_lifted_and_dropped_is_a_speed_upwards() -> None:
    carrier = Carrier()
    carrier.rest()
    for _ in range(20):
        imu = carrier.step(force=(0.0, 0.0, GRAVITY_M_S2 + 3.0))
    expected = 3.0 * 0.6 * (1 - math.exp(-20 * STEP_S / 0.6))
    assert imu.rise_m_s == pytest.approx(expected, rel=0.05)
    carrier.rest()
    for _ in range(4):
        imu = carrier.step(force=(0.0, 0.0, 0.0))
    assert imu.rise_m_s == pytest.approx(-4 * STEP_S * GRAVITY_M_S2, rel=0.1)


def test_after_a_bump_nothing_is_left_of_it() -> None:
    carrier = Carrier()
    carrier.rest()
    worst = 0.0
    for kick in (8.0, -8.0, -5.0, 5.0):
        worst = max(worst, abs(carrier.step(force=(0.0, 0.0, GRAVITY_M_S2 + kick)).rise_m_s))
    assert worst < 0.3
    assert abs(carrier.rest(0.2).rise_m_s) < 0.05


def test_what_the_wheels_miss_of_a_turn_corrects_the_heading() -> None:
    carrier = Carrier()
    carrier.rest()
    for _ in range(50):
        carrier.step((0.0, 0.0, 0.8), v=0.2, wheels=1.4)
    assert carrier.corrected_rad == pytest.approx(-0.6, abs=0.02)
    assert carrier.tracker.latest.corrected_rad == pytest.approx(carrier.corrected_rad)
    assert carrier.tracker.latest.ahead_rad == pytest.approx(-0.6, abs=1e-3)


def test_noise_and_coarse_encoders_correct_nothing() -> None:
    rng = np.random.default_rng(5)
    carrier = Carrier()
    carrier.rest(4.0)
    counted = 0.0
    for _ in range(3000):
        before, counted = counted, counted + 0.5 * STEP_S
        grain = 2 * 0.05 * math.tau / 2400 / 0.3
        wheels = (math.floor(counted / grain) - math.floor(before / grain)) * grain / STEP_S
        noise = rng.normal(0.0, 0.002, 3)
        carrier.step((*noise[:2], 0.5 + noise[2]), v=0.3, wheels=wheels)
    assert abs(carrier.corrected_rad) < 0.005


def test_a_gyro_whose_bias_is_not_known_corrects_nothing() -> None:
    carrier = Carrier()
    for _ in range(100):
        carrier.step((0.0, 0.0, 0.8), v=0.2, wheels=1.4)
    assert carrier.corrected_rad == 0.0


def test_a_pause_of_the_imu_is_no_turn() -> None:
    carrier = Carrier()
    carrier.rest()
    before = carrier.tracker.latest
    carrier.now_ns += 5_000_000_000
    imu = carrier.step((0.0, 0.0, 1.0))
    assert imu.ahead_rad == before.ahead_rad
    assert abs(carrier.corrected_rad) < 1e-9


def test_turning_by_hand_at_rest_is_no_bias() -> None:
    carrier = Carrier()
    carrier.rest()
    for _ in range(500):
        imu = carrier.step((0.0, 0.0, 0.06), wheels=0.0)
    assert imu.bias_rad_s == pytest.approx(BIAS)


@pytest.mark.parametrize("reads", [GRAVITY_M_S2 + 0.4, GRAVITY_M_S2 - 0.4])
def test_an_accelerometer_that_is_off_does_not_rise(reads: float) -> None:
    carrier = Carrier()
    for _ in range(500):
        carrier.step(force=(0.0, 0.0, reads))
    worst = max(abs(carrier.step(force=(0.0, 0.0, reads), v=0.3).rise_m_s) for _ in range(300))
    assert worst < 0.01


def test_lying_in_a_hand_that_sinks_is_not_taken_for_a_light_gravity() -> None:
    carrier = Carrier()
    carrier.rest()
    for _ in range(10):
        imu = carrier.step(force=(0.0, 0.0, GRAVITY_M_S2 - 2.0))
    assert imu.rise_m_s < -0.3
