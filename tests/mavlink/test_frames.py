"""Conversion between ENU/FLU SI and MAVLink's frames, against values computed by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common
from scipy.spatial.transform import Rotation

from robotctl.mavlink import frames

ANGLES = st.floats(-math.pi, math.pi, exclude_min=True)
LENGTHS = st.floats(-1e6, 1e6)

# Columns are the axes of ENU in NED, and of FLU in FRD: the definition of the frames.
NED_FROM_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
FRD_FROM_FLU = np.diag([1.0, -1.0, -1.0])


@pytest.mark.parametrize(
    ("theta_deg", "yaw_deg"),
    [(0, 90), (90, 0), (180, -90), (-90, 180), (45, 45), (135, -45), (-45, 135), (-135, -135)],
)
def test_east_is_yaw_90_and_north_is_yaw_0(theta_deg, yaw_deg):
    yaw = frames.yaw_ned_from_theta(math.radians(theta_deg))
    assert math.degrees(yaw) == pytest.approx(yaw_deg)


def test_one_metre_east_and_two_north_is_north_2_east_1():
    assert frames.ned_from_enu(1.0, 2.0) == (2.0, 1.0)
    assert frames.enu_from_ned(2.0, 1.0) == (1.0, 2.0)


def test_driving_east_has_an_east_velocity_and_driving_north_a_north_velocity():
    assert frames.velocity_ned(0.5, 0.0) == pytest.approx((0.0, 0.5))
    assert frames.velocity_ned(0.5, math.pi / 2) == pytest.approx((0.5, 0.0), abs=1e-12)
    assert frames.velocity_ned(-0.5, 0.0) == pytest.approx((0.0, -0.5))


@given(ANGLES, st.floats(0.01, 1.0))
def test_turning_left_lowers_the_ned_yaw_and_is_a_negative_yaw_rate(theta, turn):
    before, after = (frames.yaw_ned_from_theta(t) for t in (theta, theta + turn))
    assert math.remainder(after - before, math.tau) == pytest.approx(-turn)
    assert frames.yaw_rate_frd_from_omega(turn) < 0.0


@given(ANGLES)
def test_yaw_there_and_back_is_the_same_heading(theta):
    back = frames.theta_from_yaw_ned(frames.yaw_ned_from_theta(theta))
    assert math.remainder(back - theta, math.tau) == pytest.approx(0.0, abs=1e-12)
    assert -math.pi < back <= math.pi


@given(LENGTHS, LENGTHS)
def test_vectors_there_and_back_are_the_same(x, y):
    assert frames.enu_from_ned(*frames.ned_from_enu(x, y)) == (x, y)


@given(ANGLES)
def test_the_quaternion_maps_body_frd_to_ned_as_the_rotation_matrices_do(theta):
    w, x, y, z = frames.quaternion_from_yaw_ned(frames.yaw_ned_from_theta(theta))
    enu_from_flu = Rotation.from_euler("z", theta).as_matrix()
    expected = NED_FROM_ENU @ enu_from_flu @ FRD_FROM_FLU.T
    np.testing.assert_allclose(Rotation.from_quat([x, y, z, w]).as_matrix(), expected, atol=1e-12)


@given(ANGLES, st.floats(-2, 2))
def test_velocity_in_ned_is_the_matrix_applied_to_the_velocity_in_enu(theta, v):
    enu = np.array([v * math.cos(theta), v * math.sin(theta), 0.0])
    np.testing.assert_allclose(frames.velocity_ned(v, theta), (NED_FROM_ENU @ enu)[:2], atol=1e-12)


@pytest.mark.parametrize(
    ("heading_deg", "name"),
    [
        (0, "NONE"),
        (-45, "YAW_45"),
        (-90, "YAW_90"),
        (-135, "YAW_135"),
        (180, "YAW_180"),
        (-180, "YAW_180"),
        (135, "YAW_225"),
        (90, "YAW_270"),
        (45, "YAW_315"),
        (450, "YAW_270"),
    ],
)
def test_a_sonar_to_the_left_has_yaw_270(heading_deg, name):
    rotation = frames.sensor_rotation(math.radians(heading_deg))
    assert rotation.orientation == getattr(common, f"MAV_SENSOR_ROTATION_{name}")


def test_a_sonar_at_an_odd_angle_has_a_quaternion():
    rotation = frames.sensor_rotation(math.radians(30.0))
    assert rotation.orientation == common.MAV_SENSOR_ROTATION_CUSTOM
    # 30 degrees to the left is a rotation by -30 degrees about z down.
    assert rotation.quaternion == pytest.approx((0.9659258, 0.0, 0.0, -0.2588190))


def test_stick_to_the_right_turns_right():
    assert frames.stick_turn(1000) == -1.0
    assert frames.stick_turn(-500) == 0.5


def test_scaled_units_are_those_of_the_message_definitions():
    assert frames.millivolts(12.3456) == 12346
    assert frames.centiamperes(1.5) == 150
    assert frames.centidegrees_celsius(31.25) == 3125
    assert frames.percent(0.804) == 80
    assert frames.per_mille(0.25) == 250
    assert frames.per_ten_thousand(0.01) == 100
    assert frames.centimetres(1.234) == 123
    assert frames.boot_ms(1_234_567_890) == 1234
    assert frames.boot_us(1_234_567_890) == 1_234_567


def test_unknown_values_have_the_values_reserved_for_them():
    nan = float("nan")
    assert frames.millivolts(nan) == 0xFFFF
    assert frames.centiamperes(nan) == -1
    assert frames.percent(nan) == -1
    assert frames.centidegrees_celsius(nan) == 0x7FFF


@given(st.floats(allow_nan=False))
def test_known_values_stay_in_range_and_never_become_unknown(value):
    assert 0 <= frames.millivolts(value) < 0xFFFF
    assert -0x8000 <= frames.centiamperes(value) <= 0x7FFF
    assert frames.centiamperes(value) != -1
    assert -0x8000 <= frames.centidegrees_celsius(value) < 0x7FFF
    assert 0 <= frames.percent(value) <= 100
    assert 0 <= frames.centimetres(value) <= 0xFFFF


def test_milliseconds_since_boot_roll_over_after_49_days():
    assert frames.boot_ms((1 << 32) * 1_000_000) == 0
    assert frames.boot_ms(((1 << 32) + 7) * 1_000_000) == 7


@given(LENGTHS, LENGTHS, LENGTHS)
def test_vectors_of_the_body_turn_as_its_axes(x, y, z):
    assert frames.frd_from_flu(x, y, z) == pytest.approx(FRD_FROM_FLU @ [x, y, z])


@given(ANGLES, st.floats(-1.5, 1.5), ANGLES)
def test_an_attitude_is_that_of_the_same_body_in_other_axes(theta, pitch, roll):
    ours = Rotation.from_euler("ZYX", [theta, pitch, roll]).as_matrix()
    theirs = Rotation.from_matrix(NED_FROM_ENU @ ours @ FRD_FROM_FLU)
    euler = frames.euler_ned(roll, pitch, theta)
    built = Rotation.from_euler("ZYX", [euler.yaw, euler.pitch, euler.roll])
    assert (theirs.inv() * built).magnitude() == pytest.approx(0.0, abs=1e-6)
    w, x, y, z = frames.quaternion_from_euler(euler)
    assert (theirs.inv() * Rotation.from_quat([x, y, z, w])).magnitude() == pytest.approx(
        0.0, abs=1e-6
    )


def test_nose_up_left_side_up_and_turning_left_have_the_signs_of_aircraft():
    nose_up_left_up = frames.euler_ned(0.1, -0.2, 0.0)
    assert (nose_up_left_up.roll, nose_up_left_up.pitch) == (0.1, 0.2)  # right side down, nose up
    assert frames.frd_from_flu(0.0, 0.0, 0.5).down == -0.5


@pytest.mark.parametrize(
    ("m_s2", "expected"),
    [(0.0, 0), (9.80665, 1000), (-9.80665, -1000), (1e6, 32767), (-1e6, -32768), (math.nan, 0)],
)
def test_milligravities(m_s2, expected):
    assert frames.milligravities(m_s2) == expected


@pytest.mark.parametrize(
    ("rad_s", "expected"), [(0.0, 0), (0.0015, 2), (-1.5, -1500), (99.0, 32767), (-99.0, -32768)]
)
def test_milliradians(rad_s, expected):
    assert frames.milliradians(rad_s) == expected
