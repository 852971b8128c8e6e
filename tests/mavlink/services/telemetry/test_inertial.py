"""IMU, and the attitude by it."""

import math

import pytest
from scipy.spatial.transform import Rotation

from tests.mavlink.services.telemetry.bench import LEFT_UP_DEG, NOSE_UP_DEG, one_of_each, tilted


def test_the_imu_is_told_in_front_right_down(bench):
    message = one_of_each(bench, imu=tilted(force_m_s2=(1.0, 2.0, 9.80665)))["SCALED_IMU"]
    assert (message.xacc, message.yacc, message.zacc) == (102, -204, -1000)
    assert (message.xgyro, message.ygyro, message.zgyro) == (100, -200, -300)
    assert (message.xmag, message.ymag, message.zmag) == (0, 0, 0)
    assert message.time_boot_ms == 5000


def test_the_attitude_is_that_of_the_imu_and_its_rates_are_without_bias(bench):
    message = one_of_each(bench, imu=tilted(), theta_rad=0.7)["ATTITUDE"]
    assert math.degrees(message.roll) == pytest.approx(LEFT_UP_DEG, abs=1e-4)
    assert math.degrees(message.pitch) == pytest.approx(NOSE_UP_DEG, abs=1e-4)
    assert message.yaw == pytest.approx(math.pi / 2 - 0.7)
    assert message.rollspeed == pytest.approx(0.09)
    assert message.pitchspeed == pytest.approx(-0.18)
    assert message.yawspeed == pytest.approx(-0.27)


def test_odometry_has_the_same_attitude(bench):
    sent = one_of_each(bench, imu=tilted(), theta_rad=0.7)
    attitude, odometry = sent["ATTITUDE"], sent["ODOMETRY"]
    w, x, y, z = odometry.q
    yaw, pitch, roll = Rotation.from_quat([x, y, z, w]).as_euler("ZYX")
    told = attitude.roll, attitude.pitch, attitude.yaw
    assert told == pytest.approx((roll, pitch, yaw), abs=1e-6)
    assert (odometry.rollspeed, odometry.pitchspeed, odometry.yawspeed) == pytest.approx(
        (attitude.rollspeed, attitude.pitchspeed, attitude.yawspeed)
    )


def test_a_robot_without_an_imu_is_level_and_tells_none(bench):
    sent = one_of_each(bench, omega_rad_s=0.4)
    assert "SCALED_IMU" not in sent
    attitude = sent["ATTITUDE"]
    assert (attitude.roll, attitude.pitch, attitude.rollspeed, attitude.pitchspeed) == (0, 0, 0, 0)
    assert attitude.yawspeed == pytest.approx(-0.4)
