"""Dead reckoning with covariance: laws of cutting, and noisy wheels as oracle for every drive."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from robotctl.estimation.odometry.estimate import OdometryEstimate, arc_between
from robotctl.estimation.odometry.odometry import Odometry
from robotctl.model.drives.drives import AckermannDrive, DifferentialDrive, TricycleDrive
from robotctl.model.drives.motion import arc
from robotctl.model.drives.motion_noise import MotionNoise
from robotctl.model.geometry.pose_estimate import LocalisationStatus, PoseEstimate
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist

NOISE = MotionNoise(0.02, 0.03, 0.04)
DIFFERENTIAL = DifferentialDrive("differential", 0.3, 0.05, 2400, 1.01)
FRONT = TricycleDrive("tricycle", "front", 0.35, 0.06, 0.9, 3.0, 2400, 0.02)
REAR = dataclasses.replace(FRONT, driven="rear")
CAR = AckermannDrive("ackermann", 0.4, 0.3, 0.05, 0.6, 3.0, 2400)
STEERED = (FRONT, REAR, CAR)
NAMES = {"ids": lambda drive: f"{drive.kind}-{getattr(drive, 'driven', '')}"}

distances = st.floats(-2.0, 2.0)
angles = st.floats(-3.0, 3.0)


def start(pose=None, covariance=None):
    P = np.zeros((3, 3)) if covariance is None else covariance
    return PoseEstimate(0, pose or SE2(1.0, -2.0, 0.7), P, LocalisationStatus.LOCALISED)


def assert_same(a, b, atol=1e-9):
    assert a.pose.x_m == pytest.approx(b.pose.x_m, abs=atol)
    assert a.pose.y_m == pytest.approx(b.pose.y_m, abs=atol)
    assert math.remainder(a.pose.theta_rad - b.pose.theta_rad, math.tau) == pytest.approx(
        0.0, abs=atol
    )
    np.testing.assert_allclose(a.covariance, b.covariance, atol=atol)


@given(distances, angles, st.lists(st.floats(0.05, 1.0), min_size=1, max_size=6))
def test_a_way_cut_anywhere_gives_the_pose_and_the_covariance_of_the_whole(d, alpha, shares):
    whole, cut = OdometryEstimate(NOISE, start()), OdometryEstimate(NOISE, start())
    whole.move(d, alpha, 1)
    for share in shares:
        cut.move(d * share / sum(shares), alpha * share / sum(shares), 1)
    assert_same(cut.estimate, whole.estimate)


@pytest.mark.parametrize("drive", [DIFFERENTIAL, *STEERED], **NAMES)
@given(turn=st.floats(-20.0, 20.0), steering=st.floats(-0.5, 0.5))
def test_wheels_give_the_pose_of_the_control_process(drive, turn, steering):
    turns = (turn, 0.4 * turn) if drive is DIFFERENTIAL else (turn,)
    plain, estimate = Odometry(drive, start().pose), OdometryEstimate(NOISE, start())
    plain.update(turns, (steering,))
    estimate.move(*drive.forward(turns, (steering,))[:2], 5)
    at, expected = estimate.estimate.pose, plain.pose_odom_base
    assert (at.x_m, at.y_m) == pytest.approx((expected.x_m, expected.y_m))
    assert math.remainder(at.theta_rad - expected.theta_rad, math.tau) == pytest.approx(0.0)
    assert estimate.estimate.stamp_ns == 5


@given(st.lists(st.tuples(distances, angles), min_size=1, max_size=5), distances, angles)
def test_poses_of_an_odometry_that_stands_elsewhere_give_what_its_arcs_give(arcs, x, theta):
    by_arcs, by_poses = OdometryEstimate(NOISE, start()), OdometryEstimate(NOISE, start())
    at = SE2(x, 3.0, theta)
    by_poses.follow(at, 0)
    assert_same(by_poses.estimate, start())
    for d, alpha in arcs:
        at = arc(at, d, alpha)
        by_arcs.move(d, alpha, 7)
        by_poses.follow(at, 7)
    assert_same(by_poses.estimate, by_arcs.estimate, atol=1e-7)


@given(distances, angles)
def test_an_arc_is_found_again_from_its_ends(d, alpha):
    assert arc_between(arc(SE2(), d, alpha)) == pytest.approx((d, alpha), abs=1e-9)


def test_a_start_that_is_not_known_stays_unknown():
    P = np.diag([0.04, 0.09, 0.01])
    estimate = OdometryEstimate(MotionNoise(0.0, 0.0, 0.0), start(SE2(), P))
    estimate.move(2.0, 0.0, 1)
    # a heading of 0.1 rad that is not known moves the end aside by 0.2 m
    expected = [[0.04, 0.0, 0.0], [0.0, 0.09 + 4 * 0.01, 0.02], [0.0, 0.02, 0.01]]
    np.testing.assert_allclose(estimate.estimate.covariance, expected, atol=1e-12)


def test_after_a_reset_it_goes_on_from_the_pose_given():
    estimate = OdometryEstimate(NOISE, start())
    estimate.follow(SE2(5.0, 5.0, 0.0), 1)
    estimate.reset(start(SE2(0.0, 0.0, math.pi / 2)))
    estimate.follow(SE2(6.0, 5.0, 0.0), 2)
    assert estimate.estimate.pose.y_m == pytest.approx(1.0)
    assert estimate.estimate.covariance[1, 1] == pytest.approx(NOISE.e_m_per_sqrt_m**2)


# Noisy wheels as oracle


def mean_nees(ends, estimate):
    """Mean of the squared distance of simulated ends from the estimate, in its covariance."""
    pose = estimate.pose
    errors = np.asarray(ends) - [pose.x_m, pose.y_m, pose.theta_rad]
    errors[:, 2] = np.remainder(errors[:, 2] + math.pi, math.tau) - math.pi
    return np.mean(np.einsum("ni,ij,nj->n", errors, np.linalg.inv(estimate.covariance), errors))


def within_chi2(mean, runs, slack):
    """Whether a mean of squared errors of 3 dimensions fits, but for a relative `slack`."""
    low, high = chi2.ppf([0.001, 0.999], 3 * runs) / runs
    return low * (1.0 - slack) <= mean <= high * (1.0 + slack)


def test_a_robot_with_two_noisy_wheels_scatters_as_the_covariance_says():
    """Rolling noise of variance k a metre of each wheel: e^2 = k/2, f^2 = 2k/W^2, g^2 = k/W."""
    k, width = 4e-6, DIFFERENTIAL.track_width_m
    noise = MotionNoise(math.sqrt(k / 2), math.sqrt(2 * k) / width, math.sqrt(k / width))
    rng = np.random.default_rng(5)
    radii = np.array(DIFFERENTIAL.wheel_radii_m)
    estimate, runs, steps = OdometryEstimate(noise, start()), 4000, 40
    pose = np.tile([1.0, -2.0, 0.7], (runs, 1))
    for d, alpha in [(2.0, 0.0), (0.0, math.pi / 2)] * 4:
        turns = np.array(DIFFERENTIAL.inverse(Twist(d, alpha)).wheels_rad_s)
        estimate.move(d, alpha, 1)
        rolled = turns * radii / steps
        for _ in range(steps):
            left, right = (rolled + np.sqrt(k * np.abs(rolled)) * rng.standard_normal((runs, 2))).T
            s, turned = 0.5 * (left + right), (right - left) / width
            pose[:, 0] += s * np.cos(pose[:, 2] + 0.5 * turned)
            pose[:, 1] += s * np.sin(pose[:, 2] + 0.5 * turned)
            pose[:, 2] += turned
    # wheels that wander while it turns on the spot move it too, which e, f and g do not know
    assert within_chi2(mean_nees(pose, estimate.estimate), runs, 0.06)


@pytest.mark.parametrize("drive", STEERED, **NAMES)
def test_a_robot_with_noisy_wheel_and_steering_scatters_as_the_covariance_says(drive):
    """A steering that wanders turns it by f a root metre; e/R of the wheel does in a curve."""
    e, f, radius_m = 0.003, 0.006, 2.0
    noise = MotionNoise(e, f, e / math.sqrt(radius_m))
    rng = np.random.default_rng(6)
    estimate, runs, steps = OdometryEstimate(noise, start()), 800, 30
    poses = [start().pose] * runs
    for d, alpha in [(1.0, 0.0), (1.0, 1.0 / radius_m), (1.0, -1.0 / radius_m)]:
        wanted = drive.inverse(Twist(d, alpha))
        (wheel,), (steering,) = wanted.wheels_rad_s, wanted.joints_rad
        estimate.move(d, alpha, 1)
        wheel_sigma = e * wheel / math.sqrt(d)
        angle = steering + drive.steering_offset_rad
        # f of the heading, from d(turn)/d(angle) of the drive at this angle
        slope = (drive.forward((wheel,), (steering + 1e-6,))[1] - alpha) / 1e-6
        steering_sigma = f * math.sqrt(d) / slope
        assert abs(angle) < 0.4
        draws = rng.standard_normal((runs, steps, 2)) / math.sqrt(steps)
        for run, step in itertools.product(range(runs), range(steps)):
            turn = wheel / steps + wheel_sigma * draws[run, step, 0]
            off = steering + steps * steering_sigma * draws[run, step, 1]
            poses[run] = arc(poses[run], *drive.forward((turn,), (off,)))
    ends = [(pose.x_m, pose.y_m, pose.theta_rad) for pose in poses]
    assert within_chi2(mean_nees(ends, estimate.estimate), runs, 0.06)
