"""Noise put on recorded motion, and starts, against their laws."""

import math

import numpy as np
import pytest

from robotctl.logs.recorded_motion import (
    increments,
    known_from_ns,
    noisy,
    start_pose,
    with_noise,
    with_noisy_motion,
)
from robotctl.model.drives.motion import arc
from robotctl.model.drives.motion_noise import MotionNoise, added_covariance
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import Recording
from robotctl.model.trajectory import Trajectory

N = 20_000


def rows(motions):
    return np.array([(motion.x_m, motion.y_m, motion.theta_rad) for motion in motions])


def test_increments_put_together_are_the_way():
    rng = np.random.default_rng(1)
    poses = [SE2(*row) for row in rng.uniform(-3.0, 3.0, (20, 3))]
    pose = poses[0]
    for delta in increments(poses):
        pose = pose @ delta
    assert (pose.x_m, pose.y_m) == pytest.approx((poses[-1].x_m, poses[-1].y_m))
    assert math.cos(pose.theta_rad - poses[-1].theta_rad) == pytest.approx(1.0)


def test_no_noise_changes_nothing():
    deltas = [SE2(1.0, 0.1, 0.2), SE2()]
    assert noisy(deltas, (0.0, 0.0), np.random.default_rng(1)) == deltas


def test_noise_of_a_straight_way_grows_with_its_root():
    found = rows(noisy([SE2(0.25, 0.0, 0.0)] * N, (0.1, 0.04), np.random.default_rng(1)))
    assert found.mean(axis=0) == pytest.approx([0.25, 0.0, 0.0], abs=2e-3)
    assert found[:, 0].std() == pytest.approx(0.1 * 0.5, rel=0.03)
    assert found[:, 2].std() == pytest.approx(0.04 * 0.5, rel=0.03)


def test_noise_of_a_turn_on_the_spot_grows_with_its_root():
    found = rows(noisy([SE2(0.0, 0.0, -0.25)] * N, (0.1, 0.04), np.random.default_rng(1)))
    assert np.all(found[:, :2] == 0.0)
    assert found[:, 2].std() == pytest.approx(0.04 * 0.5, rel=0.03)


def test_noise_does_not_depend_on_how_a_way_is_cut():
    rng = np.random.default_rng(1)
    whole = rows(noisy([SE2(1.0, 0.0, 0.0)] * N, (0.1, 0.05), rng))
    halves = noisy([SE2(0.5, 0.0, 0.0)] * (2 * N), (0.1, 0.05), rng)
    joined = rows([a @ b for a, b in zip(halves[::2], halves[1::2], strict=True)])
    np.testing.assert_allclose(np.cov(joined.T), np.cov(whole.T), atol=4e-4)


@pytest.mark.parametrize(("distance", "turn"), [(0.5, 0.0), (0.2, 0.3), (0.0, 1.0)])
def test_noise_has_the_covariance_that_the_filters_expect(distance, turn):
    delta = arc(SE2(), distance, turn)
    found = np.cov(rows(noisy([delta] * N, (0.1, 0.2), np.random.default_rng(1))).T)
    expected = added_covariance(SE2(), distance, turn, MotionNoise(0.1, 0.2, 0.2))
    np.testing.assert_allclose(found, expected, atol=0.02 * np.max(expected))


def test_variances_of_own_and_put_noise_add():
    found = with_noise(MotionNoise(0.3, 0.03, 0.09), (0.4, 0.04))
    values = (found.e_m_per_sqrt_m, found.f_rad_per_sqrt_m, found.g_rad_per_sqrt_rad)
    assert values == pytest.approx((0.5, 0.05, math.sqrt(0.0097)))


def test_velocities_get_the_noise_of_the_way_that_they_drive():
    stamps_ns = 10**8 * np.arange(N + 1)
    recording = Recording("a", twist_stamps_ns=stamps_ns, twists=np.tile([0.5, 0.0], (N + 1, 1)))
    found = with_noisy_motion(recording, (0.1, 0.04), np.random.default_rng(1)).twists[:-1]
    assert found.mean(axis=0) == pytest.approx([0.5, 0.0], abs=3e-2)
    assert 0.1 * found[:, 0].std() == pytest.approx(0.1 * math.sqrt(0.05), rel=0.03)
    assert 0.1 * found[:, 1].std() == pytest.approx(0.04 * math.sqrt(0.05), rel=0.03)


def test_an_odometry_gets_the_noise_of_each_step_and_keeps_its_start():
    rows_ = np.stack([0.5 * np.arange(N + 1), np.ones(N + 1), np.zeros(N + 1)], axis=1)
    recording = Recording("a", odometry=Trajectory(np.arange(N + 1), rows_))
    found = with_noisy_motion(recording, (0.1, 0.0), np.random.default_rng(1)).odometry.poses
    assert found[0].tolist() == rows_[0].tolist()
    assert np.diff(found[:, 0]).std() == pytest.approx(0.1 * math.sqrt(0.5), rel=0.03)
    assert np.all(found[:, 1:] == rows_[:, 1:])


def drive(heading_rad, has_heading, begin_ns=0):
    """An odometry along a bend, and the same seen from outside, turned."""
    stamps_ns = begin_ns + 10**8 * np.arange(60)
    theta = 0.02 * np.arange(60)
    odometry = np.stack([np.cumsum(0.05 * np.cos(theta)), np.cumsum(0.05 * np.sin(theta)), theta])
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    seen = np.array([[c, -s], [s, c]]) @ odometry[:2] + [[5.0], [7.0]]
    reference = np.stack([*seen, theta + heading_rad if has_heading else np.zeros(60)], axis=1)
    return Recording(
        "drive",
        odometry=Trajectory(stamps_ns, odometry.T),
        reference=Trajectory(stamps_ns, reference),
        reference_has_heading=has_heading,
    )


@pytest.mark.parametrize("has_heading", [True, False])
@pytest.mark.parametrize("heading_rad", [0.0, 2.0, -3.0])
def test_the_start_is_the_reference_with_its_heading_or_that_of_the_fitting_odometry(
    has_heading, heading_rad
):
    recording = drive(heading_rad, has_heading)
    start = start_pose(recording, 0)
    assert (start.x_m, start.y_m) == pytest.approx(tuple(recording.reference.poses[0, :2]))
    assert start.theta_rad == pytest.approx(heading_rad)


def test_up_to_a_second_before_the_reference_its_first_pose_counts():
    recording = drive(1.0, has_heading=True, begin_ns=2 * 10**9)
    assert known_from_ns(recording) == 10**9
    assert start_pose(recording, 10**9).theta_rad == pytest.approx(1.0)
    assert start_pose(recording, 10**9 - 1) is None


def test_a_robot_that_never_moves_shows_no_heading():
    still = Trajectory(np.arange(10) * 10**8, np.zeros((10, 3)))
    recording = Recording("a", odometry=still, reference=still, reference_has_heading=False)
    assert start_pose(recording, 0) is None


def test_without_a_reference_there_is_no_start():
    assert start_pose(Recording("a"), 0) is None
