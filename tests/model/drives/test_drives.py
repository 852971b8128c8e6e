"""Drive models: round trips, the notes' formulas with their errata, and the steering linkage."""

import dataclasses
import math
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.model.drives.drives import (
    AckermannDrive,
    ActuatorReference,
    DifferentialDrive,
    Drive,
    MecanumDrive,
    OmniDrive,
    SkidSteerDrive,
    TricycleDrive,
)
from robotctl.model.geometry.twist import Twist

DIFFERENTIAL = DifferentialDrive("differential", 0.3, 0.05, 2400)
FRONT = TricycleDrive("tricycle", "front", 0.35, 0.06, 1.0, 3.0, 2400)
REAR = TricycleDrive("tricycle", "rear", 0.35, 0.06, 1.0, 3.0, 2400)
CAR = AckermannDrive("ackermann", 0.4, 0.3, 0.05, 0.6, 3.0, 2400)
SKID_4 = SkidSteerDrive("skid_steer", 0.4, 0.3, 0.08, 2400, slip_factor=1.6)
SKID_6 = SkidSteerDrive("skid_steer", 0.4, 0.5, 0.08, 2400, wheels_per_side=3)
MECANUM = MecanumDrive("mecanum", 0.4, 0.3, 0.076, 2400)
OMNI_3 = OmniDrive("omni", 3, 0.2, 0.05, 2400)
OMNI_4 = OmniDrive("omni", 4, 0.2, 0.05, 2400, first_wheel_deg=45.0)
STEERED = (FRONT, REAR, CAR)
HOLONOMIC = (MECANUM, OMNI_3, OMNI_4)
ALL = (DIFFERENTIAL, *STEERED, SKID_4, SKID_6, *HOLONOMIC)

speeds = st.floats(0.01, 2.0) | st.floats(-2.0, -0.01)
rates = st.floats(-3.0, 3.0)
steerings = st.floats(-0.6, 0.6)
NAMES = {"ids": lambda d: f"{d.kind}-{len(d.wheel_names)}"}


def forward(drive, reference):
    return drive.forward(reference.wheels_rad_s, reference.joints_rad)


def test_all_kinds_are_tested():
    assert {type(drive) for drive in ALL} == set(get_args(Drive))


@pytest.mark.parametrize("drive", ALL, **NAMES)
def test_every_drive_has_three_degrees_of_freedom_and_its_wheels_and_joints(drive):
    assert drive.degrees_of_freedom == 3
    assert drive.holonomic is (drive in HOLONOMIC)
    assert len(drive.joint_names) == len(drive.joint_max_rad) == len(drive.joint_rate_max_rad_s)
    assert len(drive.wheel_radii_m) == len(set(drive.wheel_names))
    assert drive.steered == bool(drive.joint_names) == (drive.min_turning_radius_m > 0.0)


@pytest.mark.parametrize("drive", [d for d in ALL if not d.steered], **NAMES)
@given(v=st.floats(-2.0, 2.0), omega=rates, vy=st.floats(-2.0, 2.0))
def test_a_drive_that_turns_on_the_spot_gives_back_any_twist_that_it_can_have(drive, v, omega, vy):
    wanted = Twist(v, omega, vy if drive.holonomic else 0.0)
    assert forward(drive, drive.inverse(wanted)) == pytest.approx(wanted, abs=1e-12)


@pytest.mark.parametrize("drive", ALL, **NAMES)
@given(data=st.data())
def test_forward_is_linear_in_the_wheel_speeds(drive, data):
    """Odometry relies on it: increments of the angles give the increment of the pose."""
    n = len(drive.wheel_names)
    a, b = (data.draw(st.tuples(*[st.floats(-20.0, 20.0)] * n)) for _ in range(2))
    joints = tuple(data.draw(steerings) for _ in drive.joint_names)
    summed = drive.forward(tuple(x + 2.0 * y for x, y in zip(a, b, strict=True)), joints)
    apart = np.add(drive.forward(a, joints), 2.0 * np.array(drive.forward(b, joints)))
    np.testing.assert_allclose(summed, apart, atol=1e-9)


CONTACTS = (  # of a mecanum wheel: x, y [m], and the direction of the axis of the roller there
    (0.15, 0.2, (1.0, -1.0)),
    (0.15, -0.2, (1.0, 1.0)),
    (-0.15, 0.2, (1.0, 1.0)),
    (-0.15, -0.2, (1.0, -1.0)),
)


@given(v=st.floats(-2.0, 2.0), omega=rates, vy=st.floats(-2.0, 2.0))
def test_a_mecanum_wheel_moves_its_contact_along_the_axis_of_its_roller(v, omega, vy):
    """Rigid body: along the roller's axis the rim is as fast as the body; across it, it rolls."""
    wheels = MECANUM.inverse(Twist(v, omega, vy)).wheels_rad_s
    for (x, y, along), speed in zip(CONTACTS, wheels, strict=True):
        body = (v - omega * y) * along[0] + (vy + omega * x) * along[1]
        assert speed * MECANUM.wheel_radius_m * along[0] == pytest.approx(body, abs=1e-9)


@pytest.mark.parametrize("drive", [OMNI_3, OMNI_4], **NAMES)
@given(v=st.floats(-2.0, 2.0), omega=rates, vy=st.floats(-2.0, 2.0))
def test_an_omni_wheel_moves_its_contact_along_the_circle(drive, v, omega, vy):
    wheels = drive.inverse(Twist(v, omega, vy)).wheels_rad_s
    first, step = math.radians(drive.first_wheel_deg), 2.0 * math.pi / drive.wheels
    for k, speed in enumerate(wheels):
        x, y = 0.2 * math.cos(first + k * step), 0.2 * math.sin(first + k * step)
        along = -math.sin(first + k * step), math.cos(first + k * step)
        body = (v - omega * y) * along[0] + (vy + omega * x) * along[1]
        assert speed * drive.wheel_radius_m == pytest.approx(body, abs=1e-9)


@pytest.mark.parametrize("drive", HOLONOMIC, **NAMES)
@given(data=st.data())
def test_wheels_that_contradict_each_other_give_the_twist_that_fits_best(drive, data):
    n = len(drive.wheel_names)
    speeds = data.draw(st.tuples(*[st.floats(-20.0, 20.0)] * n))
    columns = [drive.inverse(Twist(*row)).wheels_rad_s for row in np.eye(3).tolist()]
    best = np.linalg.lstsq(np.array(columns).T, np.array(speeds), rcond=None)[0]
    np.testing.assert_allclose(drive.forward(speeds), best, atol=1e-9)


def test_equal_mecanum_wheels_drive_ahead_and_crossed_ones_sideways():
    assert MECANUM.forward((1.0, 1.0, 1.0, 1.0)) == pytest.approx((0.076, 0.0, 0.0))
    assert MECANUM.forward((-1.0, 1.0, 1.0, -1.0)) == pytest.approx((0.0, 0.0, 0.076))


@pytest.mark.parametrize("drive", [SKID_4, SKID_6], **NAMES)
@given(v=st.floats(-2.0, 2.0), omega=rates)
def test_a_skid_steer_robot_turns_as_a_differential_one_with_its_effective_track(drive, v, omega):
    wide = DifferentialDrive("differential", drive.slip_factor * 0.4, 0.08, 2400)
    left, right = wide.inverse(Twist(v, omega)).wheels_rad_s
    wheels = drive.inverse(Twist(v, omega)).wheels_rad_s
    assert wheels == pytest.approx((left, right) * drive.wheels_per_side)


@pytest.mark.parametrize("drive", STEERED, ids=lambda d: f"{d.kind}")
@given(v=speeds, share=st.floats(-1.0, 1.0))
def test_a_drive_and_steer_robot_gives_back_any_twist_within_reach(drive, v, share):
    omega = share * v / drive.min_turning_radius_m
    twist = forward(drive, drive.inverse(Twist(v, omega)))
    assert twist.v_m_s == pytest.approx(v, rel=1e-12)
    assert twist.omega_rad_s == pytest.approx(omega, abs=1e-12)


@pytest.mark.parametrize("drive", STEERED, ids=lambda d: f"{d.kind}")
@given(v=speeds, excess=st.floats(1.001, 1e6), side=st.sampled_from([-1.0, 1.0]))
def test_a_curvature_out_of_reach_is_clamped_and_the_speed_kept(drive, v, excess, side):
    omega = side * excess * v / drive.min_turning_radius_m
    wanted = drive.inverse(Twist(v, omega))
    twist = forward(drive, wanted)
    assert abs(wanted.joints_rad[0]) == drive.steering_max_rad
    assert twist.v_m_s == pytest.approx(v, rel=1e-12)
    assert twist.v_m_s / twist.omega_rad_s == pytest.approx(
        math.copysign(drive.min_turning_radius_m, v * omega)
    )


@pytest.mark.parametrize("drive", STEERED, ids=lambda d: f"{d.kind}")
@pytest.mark.parametrize("beyond_rad", [1e-6, 0.001, 0.3])
def test_a_standing_robot_steers_no_farther_than_its_linkage(drive, beyond_rad):
    for side in (1.0, -1.0):
        measured_rad = side * (drive.steering_max_rad + beyond_rad)
        kept_rad = drive.inverse(Twist(0.0, 0.0), (measured_rad,)).joints_rad
        assert kept_rad == (side * drive.steering_max_rad,)


@pytest.mark.parametrize("drive", STEERED, ids=lambda d: f"{d.kind}")
def test_a_standing_robot_keeps_its_steering(drive):
    assert drive.inverse(Twist(0.0, 1.0), (0.21,)) == ActuatorReference((0.0,), (0.21,))


def test_wheels_of_a_differential_drive_run_on_radii_half_a_track_to_each_side():
    R, angle, W = 1.3, 0.4, 0.3
    left, right = (R - W / 2) * angle, (R + W / 2) * angle  # in one second
    twist = DIFFERENTIAL.forward((left / 0.05, right / 0.05))
    assert twist.omega_rad_s == pytest.approx(angle)
    assert twist.v_m_s == pytest.approx(R * angle)
    assert DIFFERENTIAL.turning_radius_m(left, right) == pytest.approx(R)


def test_equal_wheel_speeds_have_an_infinite_radius_and_opposite_ones_none():
    assert DIFFERENTIAL.turning_radius_m(0.4, 0.4) == math.inf
    assert DIFFERENTIAL.turning_radius_m(-0.4, 0.4) == 0.0
    assert DIFFERENTIAL.forward((3.0, 3.0)).omega_rad_s == 0.0
    assert DIFFERENTIAL.min_turning_radius_m == 0.0


@given(st.floats(-20.0, 20.0), steerings)
def test_front_drive_turns_with_the_sine_and_rear_drive_with_the_tangent(omega1, s):
    v = omega1 * 0.06
    assert FRONT.forward((omega1,), (s,)).omega_rad_s == pytest.approx(v * math.sin(s) / 0.35)
    assert REAR.forward((omega1,), (s,)).omega_rad_s == pytest.approx(v * math.tan(s) / 0.35)


@given(st.floats(0.1, 20.0), st.floats(0.01, 0.6))
def test_the_front_wheel_rolls_along_its_own_larger_circle(omega1, s):
    """Rigid body: the velocity of the front wheel is v + omega x (L, 0), along the wheel."""
    twist = FRONT.forward((omega1,), (s,))
    vx, vy = twist.v_m_s, twist.omega_rad_s * FRONT.wheelbase_m
    assert math.hypot(vx, vy) == pytest.approx(omega1 * FRONT.wheel_radius_m)
    assert math.atan2(vy, vx) == pytest.approx(s)
    assert math.hypot(vx, vy) / twist.omega_rad_s == pytest.approx(FRONT.front_turning_radius_m(s))
    assert twist.v_m_s / twist.omega_rad_s == pytest.approx(FRONT.turning_radius_m(s))


@pytest.mark.parametrize("drive", STEERED, ids=lambda d: f"{d.kind}")
def test_straight_steering_has_an_infinite_radius_and_full_steering_the_smallest(drive):
    assert drive.turning_radius_m(0.0) == math.inf
    full = drive.turning_radius_m(-drive.steering_max_rad)
    assert -full == pytest.approx(drive.min_turning_radius_m)


@pytest.mark.parametrize("drive", ALL, ids=lambda d: d.kind)
def test_a_length_that_is_not_positive_is_refused_by_name(drive):
    for key in ("wheel_radius_m", "counts_per_revolution"):
        for value in (0, -1, math.nan, math.inf):
            with pytest.raises(ValueError, match=key):
                dataclasses.replace(drive, **{key: value})


@pytest.mark.parametrize("limit", [0.0, -0.2, math.pi / 2, math.nan])
@pytest.mark.parametrize("drive", STEERED, ids=lambda d: f"{d.kind}")
def test_a_steering_limit_out_of_its_range_is_refused(drive, limit):
    with pytest.raises(ValueError, match="steering_max_rad"):
        dataclasses.replace(drive, steering_max_rad=limit)


def test_a_car_whose_centre_of_rotation_lies_between_its_wheels_is_refused():
    with pytest.raises(ValueError, match="between the wheels"):
        dataclasses.replace(CAR, steering_max_rad=1.3)


@pytest.mark.parametrize("drive", ALL, ids=lambda d: d.kind)
def test_nan_goes_through_and_is_not_turned_into_a_valid_command(drive):
    for twist in (Twist(0.3, math.nan), Twist(math.nan, 0.1)):
        wanted = drive.inverse(twist)
        assert any(map(math.isnan, (*wanted.wheels_rad_s, *wanted.joints_rad)))
    if drive.steered:
        assert math.isnan(drive.inverse(Twist(0.0, 0.0), (math.nan,)).joints_rad[0])


# What calibration brings: unequal wheels, a steering that does not stand where it says


UNEQUAL = dataclasses.replace(DIFFERENTIAL, wheel_radius_ratio=1.02)
SKEWED = tuple(dataclasses.replace(drive, steering_offset_rad=0.05) for drive in STEERED)


def test_unequal_wheels_have_the_mean_radius_and_the_ratio():
    left_m, right_m = UNEQUAL.wheel_radii_m
    assert right_m / left_m == pytest.approx(1.02)
    assert 0.5 * (left_m + right_m) == pytest.approx(UNEQUAL.wheel_radius_m)


def test_with_a_greater_right_wheel_equal_turns_bend_to_the_left():
    """One turn of both wheels: the right one's rim moves on by 2 pi (R_right - R_left) more."""
    left_m, right_m = UNEQUAL.wheel_radii_m
    moved_m, turned_rad, _ = UNEQUAL.forward((math.tau, math.tau))
    assert moved_m == pytest.approx(math.tau * UNEQUAL.wheel_radius_m)
    assert turned_rad == pytest.approx(math.tau * (right_m - left_m) / UNEQUAL.track_width_m)


@given(st.floats(-2.0, 2.0), rates)
def test_unequal_wheels_give_back_any_twist(v, omega):
    twist = forward(UNEQUAL, UNEQUAL.inverse(Twist(v, omega)))
    assert twist.v_m_s == pytest.approx(v, abs=1e-12)
    assert twist.omega_rad_s == pytest.approx(omega, abs=1e-12)


@pytest.mark.parametrize("drive", SKEWED, ids=lambda d: f"{d.kind}")
@given(v=speeds, share=st.floats(-1.0, 1.0))
def test_a_skewed_steering_gives_back_any_twist_within_reach(drive, v, share):
    omega = share * v / drive.min_turning_radius_m
    wanted = drive.inverse(Twist(v, omega))
    twist = forward(drive, wanted)
    assert abs(wanted.joints_rad[0]) <= drive.steering_max_rad
    assert twist.v_m_s == pytest.approx(v, rel=1e-12)
    assert twist.omega_rad_s == pytest.approx(omega, abs=1e-12)


@pytest.mark.parametrize("drive", SKEWED, ids=lambda d: f"{d.kind}")
def test_a_skewed_steering_at_zero_bends_the_way_by_its_offset(drive):
    plain = dataclasses.replace(drive, steering_offset_rad=0.0)
    assert drive.forward((3.0,), (0.1,)) == pytest.approx(plain.forward((3.0,), (0.15,)))


@pytest.mark.parametrize("offset_rad", [1.0, -1.5, math.nan])
def test_an_offset_that_leaves_no_way_to_one_side_is_refused(offset_rad):
    with pytest.raises(ValueError, match=r"steering_offset_rad must be between -0.571 and 0.571"):
        dataclasses.replace(FRONT, steering_offset_rad=offset_rad)


@pytest.mark.parametrize("ratio", [0.4, 2.1, math.nan])
def test_wheels_of_wholly_different_sizes_are_refused(ratio):
    with pytest.raises(ValueError, match="wheel_radius_ratio must be between"):
        dataclasses.replace(DIFFERENTIAL, wheel_radius_ratio=ratio)
