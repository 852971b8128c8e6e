"""Attitude, position and odometry."""

import math

import pytest
from pymavlink.dialects.v20 import common

from tests.mavlink.services.telemetry.bench import one_of_each


def test_facing_north_east_and_turning_left_reads_as_yaw_45_and_negative_yaw_speed(bench):
    sent = one_of_each(bench, x_m=1.0, y_m=2.0, theta_rad=math.pi / 4, v_m_s=0.5, omega_rad_s=0.25)
    attitude = sent["ATTITUDE"]
    assert math.degrees(attitude.yaw) == pytest.approx(45.0, abs=1e-4)
    assert attitude.yawspeed == pytest.approx(-0.25)
    assert (attitude.roll, attitude.pitch) == (0.0, 0.0)
    position = sent["LOCAL_POSITION_NED"]
    assert (position.x, position.y, position.z) == pytest.approx((2.0, 1.0, 0.0))
    assert position.vx == pytest.approx(0.5 * math.sqrt(0.5))
    assert position.vy == pytest.approx(0.5 * math.sqrt(0.5))
    odometry = sent["ODOMETRY"]
    assert odometry.frame_id == common.MAV_FRAME_LOCAL_NED
    assert odometry.child_frame_id == common.MAV_FRAME_BODY_FRD
    assert (odometry.x, odometry.y) == pytest.approx((2.0, 1.0))
    half = math.radians(22.5)
    assert odometry.q == pytest.approx([math.cos(half), 0.0, 0.0, math.sin(half)])
    assert (odometry.vx, odometry.vy) == pytest.approx((0.5, 0.0))
    assert odometry.yawspeed == pytest.approx(-0.25)
    assert math.isnan(odometry.pose_covariance[0])


def test_time_stamps_are_those_of_the_state(bench):
    bench.step(bench.control())
    stamp_ns = bench.now_ns
    assert bench.messages("ATTITUDE")[0].time_boot_ms == stamp_ns // 1_000_000


def test_the_odometry_reset_counter_counts_restarts_of_control(bench):
    bench.step(bench.control(odom_epoch_ns=1))
    bench.run(0.1, odom_epoch_ns=1)
    assert {message.reset_counter for message in bench.messages("ODOMETRY")} == {0}
    bench.run(0.5, odom_epoch_ns=2)
    assert {message.reset_counter for message in bench.messages("ODOMETRY")} == {1}
