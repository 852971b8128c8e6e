"""EKF-SLAM against the textbook's with whole matrices, and the laws of its covariance."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.estimation.kalman.chi_squared import chi2_bounds
from robotctl.estimation.slam.ekf_slam.features import POINT
from robotctl.estimation.slam.ekf_slam.filter import EkfSlam
from robotctl.model.drives.motion import arc
from robotctl.model.drives.motion_noise import MotionNoise, added_covariance, pose_jacobian
from robotctl.model.geometry.se2 import SE2
from tests.estimation.slam.ekf_slam.textbook import DenseSlam, R, drive

NOISE = MotionNoise(0.02, 0.02, 0.03)
START = np.diag([0.01, 0.02, 0.005])
seeds = st.integers(0, 2**32 - 1)


def both(seed, steps=40):
    """Drive once with both filters; features are also removed now and then."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-8.0, 8.0, (25, 2))
    slam, dense = EkfSlam(np.zeros(3), START, invariant=False), DenseSlam(np.zeros(3), START)
    for k, (d, a, _, near, z) in enumerate(drive(rng, steps, points, NOISE)):
        pose = slam.pose
        moved = arc(pose, d, a)
        x_v = [moved.x_m, moved.y_m, moved.theta_rad]
        dense.predict(x_v, pose_jacobian(pose, d, a), added_covariance(pose, d, a, NOISE))
        slam.move(d, a, NOISE)
        known = [number for number, name in enumerate(near) if slam.index(name) is not None]
        which = [slam.index(near[number]) for number in known]
        nis = slam.sight(POINT, near.tolist(), z, np.tile(R, (len(near), 1, 1)))
        if known:
            assert dense.update(which, z[known]) == pytest.approx(nis, rel=1e-6)
        for number in range(len(near)):
            if number not in known:
                dense.add(z[number])
        if k % 9 == 8 and len(slam.names):
            gone = int(rng.integers(len(slam.names)))
            slam.remove(gone)
            dense.remove(gone)
    return slam, dense


@settings(max_examples=15)
@given(seeds)
def test_it_is_the_textbooks_filter_with_whole_matrices(seed):
    slam, dense = both(seed)
    assert slam.belief.x == pytest.approx(dense.x, abs=1e-9)
    assert slam.belief.covariance() == pytest.approx(dense.P, abs=1e-10)


def test_the_pose_and_each_feature_have_their_part_of_the_covariance():
    slam, dense = both(3)
    assert slam.pose_covariance() == pytest.approx(dense.P[:3, :3], abs=1e-10)
    for number in range(len(slam.names)):
        own = slice(3 + 2 * number, 5 + 2 * number)
        assert slam.covariance(number) == pytest.approx(dense.P[own, own], abs=1e-10)
    with pytest.raises(IndexError, match="there are"):
        slam.covariance(len(slam.names))


def test_the_names_stay_with_their_features():
    slam, _ = both(5)
    assert [slam.index(name) for name in slam.names] == list(range(len(slam.names)))
    gone, last = slam.names[0], slam.features[-1].copy()
    name = slam.names[-1]
    slam.remove(0)
    assert slam.index(gone) is None
    assert slam.features[slam.index(name)] == pytest.approx(last)


def test_moving_changes_only_what_is_of_the_robot():
    slam, _ = both(7)
    before = slam.belief.covariance()
    slam.move(0.3, 0.2, NOISE)
    after = slam.belief.covariance()
    assert np.array_equal(before[3:, 3:], after[3:, 3:])
    assert np.linalg.eigvalsh(after).min() > 0.0


def test_a_measurement_without_noise_of_a_certain_feature_is_refused():
    slam = EkfSlam(np.zeros(3), np.zeros((3, 3)))
    none = np.zeros((1, 2, 2))
    slam.add(POINT, 1, np.array([2.0, 0.1]), none[0])
    with pytest.raises(ValueError, match="positive definite"):
        slam.update(POINT, np.array([0]), np.array([[2.0, 0.1]]), none)
    assert slam.features[0] == pytest.approx([2.0 * np.cos(0.1), 2.0 * np.sin(0.1)])


def run(seed, *, invariant=True, noise=NOISE, start=START):
    """Return the filter after a drive, its NEES, and what it learned of a turn of the whole.

    The last is the information on it over that at the start: no more than 1, as nothing measures
    it. (A robot that starts with doubt draws its start from that.)
    """
    rng = np.random.default_rng(seed)
    points = rng.uniform([-6.0, -4.0], [8.0, 12.0], (30, 2))
    x_v = np.sqrt(np.diag(start)) * rng.standard_normal(3)
    slam = EkfSlam(x_v, start, invariant=invariant)
    steps = list(drive(rng, 100, points, noise))
    for d, a, _, near, z in steps:
        slam.move(d, a, noise)
        slam.sight(POINT, near.tolist(), z, np.tile(R, (len(near), 1, 1)))
    pose = slam.pose
    turn = [-pose.y_m, pose.x_m, 1.0]
    for x, y in slam.features:
        turn += [-y, x]
    learned = turn @ np.linalg.solve(slam.belief.covariance(), turn)
    begin = np.array([-x_v[1], x_v[0], 1.0])
    return slam.nees(steps[-1][2]), learned / (begin @ np.linalg.solve(start, begin))


def test_the_errors_over_50_drives_are_what_the_covariance_says():
    unsure = np.diag([0.01, 0.02, 0.1])
    nees = [run(seed, start=unsure)[0] for seed in range(50)]
    low, high = chi2_bounds(3 * len(nees), 0.99)
    assert low <= sum(nees) <= high


def test_the_textbooks_filter_is_too_sure_of_it():
    seeds = range(100, 110)
    _, high = chi2_bounds(3 * len(seeds), 0.99)
    assert sum(run(seed, invariant=False)[0] for seed in seeds) > 1.5 * high


@pytest.mark.parametrize("seed", range(2))
def test_nothing_is_learned_of_a_turn_of_the_whole_but_by_the_textbooks_filter(seed):
    assert run(seed)[1] <= 1.0 + 1e-6
    assert run(seed, invariant=False)[1] > 1.1


@pytest.mark.parametrize("seed", range(2))
def test_a_turned_and_moved_world_gives_the_same_turned_and_moved(seed):
    rng = np.random.default_rng(seed)
    steps = list(drive(rng, 30, rng.uniform(-6.0, 6.0, (20, 2)), NOISE))
    T = SE2(3.0, -2.0, 2.5)
    M = np.eye(3)
    M[:2, :2] = [[np.cos(2.5), -np.sin(2.5)], [np.sin(2.5), np.cos(2.5)]]
    one = EkfSlam(np.zeros(3), START)
    other = EkfSlam(np.array([T.x_m, T.y_m, T.theta_rad]), M @ START @ M.T)
    for slam in (one, other):
        for d, a, _, near, z in steps:
            slam.move(d, a, NOISE)
            slam.sight(POINT, near.tolist(), z, np.tile(R, (len(near), 1, 1)))
    for (x, y), found in zip(one.features, other.features, strict=True):
        assert found == pytest.approx(T.apply(x, y), abs=1e-9)
    moved = T @ one.pose
    assert other.pose.x_m == pytest.approx(moved.x_m, abs=1e-9)
    whole = np.kron(np.eye(len(one.names) + 1), M[:2, :2])
    whole = np.insert(np.insert(whole, 2, 0.0, axis=0), 2, 0.0, axis=1)
    whole[2, 2] = 1.0
    P = whole @ one.belief.covariance() @ whole.T
    assert other.belief.covariance() == pytest.approx(P, abs=1e-9)
