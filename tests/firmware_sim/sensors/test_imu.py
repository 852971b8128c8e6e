"""The simulated IMU against mechanics: gravity, circles, straight lines, tilts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from firmware_sim.config.parameters import ImuMount, ImuParameters
from firmware_sim.sensors.imu import GRAVITY_M_S2, BodyMotion, Imu, Tilt

QUIET = ImuParameters(0.0, 0.0, 0.0, 0.0, 0.0)
REST = BodyMotion(1.0, 2.0, 0.7, 0.0, 0.0, 0.0)
STEP_NS = 10_000_000


def make(parameters=QUIET, seed=1, **mount):
    return Imu(parameters, ImuMount(enabled=True, **mount), np.random.default_rng(seed))


def test_at_rest_the_floor_is_all_it_feels():
    imu = make(x_m=0.1, y_m=-0.2)
    for n in range(3):
        sample = imu.sample(n * STEP_NS, REST)
        assert sample.rate_rad_s == pytest.approx((0, 0, 0))
        assert sample.force_m_s2 == pytest.approx((0, 0, GRAVITY_M_S2))


@pytest.mark.parametrize("mount", [(0.0, 0.0), (0.2, 0.0), (-0.1, 0.15)])
@pytest.mark.parametrize("yaw_deg", [0.0, 90.0, -30.0])
def test_on_a_circle_it_feels_the_turn_and_the_way_to_the_centre(mount, yaw_deg):
    v, omega = 0.6, 1.5
    x_m, y_m = mount
    imu = make(x_m=x_m, y_m=y_m, yaw_deg=yaw_deg)
    for n in range(5):
        t = n * STEP_NS * 1e-9
        turn = omega * t
        place = v / omega * math.sin(turn), v / omega * (1 - math.cos(turn))
        sample = imu.sample(n * STEP_NS, BodyMotion(*place, turn, v, 0.0, omega))
    forward, left = -(omega**2) * x_m, v * omega - omega**2 * y_m
    yaw = math.radians(yaw_deg)
    c, s = math.cos(yaw), math.sin(yaw)
    expected = c * forward + s * left, -s * forward + c * left
    assert sample.force_m_s2[:2] == pytest.approx(expected, rel=1e-3)
    assert sample.rate_rad_s == pytest.approx((0, 0, omega))


def test_speeding_up_pushes_forward():
    imu = make()
    for n in range(3):
        v = 1.5 * n * STEP_NS * 1e-9
        sample = imu.sample(n * STEP_NS, REST._replace(v_m_s=v))
    assert sample.force_m_s2 == pytest.approx((1.5, 0, GRAVITY_M_S2))


@pytest.mark.parametrize("roll_deg", [-40.0, 0.0, 15.0])
@pytest.mark.parametrize("pitch_deg", [-30.0, 0.0, 60.0])
def test_a_tilted_robot_feels_the_floor_along_its_own_axes(roll_deg, pitch_deg):
    roll, pitch = math.radians(roll_deg), math.radians(pitch_deg)
    imu = make()
    sample = imu.sample(0, REST, Tilt(roll, pitch))
    turned = Rotation.from_euler("ZYX", [0.3, pitch, roll])
    assert sample.force_m_s2 == pytest.approx(tuple(turned.inv().apply([0, 0, GRAVITY_M_S2])))


def test_the_rates_of_a_robot_that_turns_and_tilts_give_its_attitude_back():
    imu, dt_s = make(), 1e-3
    attitude = Rotation.identity()
    for n in range(2000):
        t = n * dt_s
        tilt = Tilt(0.3 * math.sin(2 * t), 0.5 * math.sin(t))
        sample = imu.sample(n * 1_000_000, BodyMotion(0, 0, 0.8 * t, 0, 0, 0.8), tilt)
        if n:
            attitude = attitude * Rotation.from_rotvec(np.array(sample.rate_rad_s) * dt_s)
    true = Rotation.from_euler("ZYX", [0.8 * t, tilt.pitch_rad, tilt.roll_rad])
    assert (attitude.inv() * true).magnitude() < 2e-3


def test_bias_and_noise_are_those_of_the_parameters_and_of_the_seed():
    parameters = ImuParameters(0.002, 0.01, 0.03, 0.05, 0.0)
    imu = make(parameters)
    samples = [imu.sample(n * STEP_NS, REST) for n in range(4000)]
    rates = np.array([each.rate_rad_s for each in samples])
    forces = np.array([each.force_m_s2 for each in samples]) - [0, 0, GRAVITY_M_S2]
    assert rates.mean(axis=0) == pytest.approx(imu.gyro_bias_rad_s, abs=2e-4)
    assert rates.std(axis=0) == pytest.approx([0.002] * 3, rel=0.05)
    assert forces.mean(axis=0) == pytest.approx(imu.force_bias_m_s2, abs=3e-3)
    assert forces.std(axis=0) == pytest.approx([0.03] * 3, rel=0.05)
    again, other = make(parameters), make(parameters, seed=2)
    assert again.sample(0, REST) == samples[0] != other.sample(0, REST)
    drawn = [make(parameters, seed=n).gyro_bias_rad_s for n in range(400)]
    assert np.std(drawn) == pytest.approx(0.01, rel=0.1)
