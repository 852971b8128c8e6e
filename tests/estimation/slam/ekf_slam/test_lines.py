"""Walls as features: their Jacobians, and the consistency of a filter that knows nothing else."""

import math

import numpy as np
import pytest

from robotctl.estimation.kalman.chi_squared import chi2_bounds
from robotctl.estimation.slam.ekf_slam.features import LINE
from robotctl.estimation.slam.ekf_slam.filter import NEW, EkfSlam
from robotctl.model.drives.motion import arc
from robotctl.model.drives.motion_noise import MotionNoise
from robotctl.model.geometry.se2 import SE2

pytestmark = pytest.mark.timeout(600)  # the first of them compiles
NOISE = MotionNoise(0.02, 0.02, 0.03)
R = np.diag([0.01**2, 0.02**2])
SEEDS = 20


def walls(rng):
    """Return lines around the origin, whose normals point outwards, (k, 2)."""
    alpha = np.arange(8) * math.pi / 4.0 + rng.uniform(-0.2, 0.2, 8)
    return np.column_stack([alpha, rng.uniform(6.0, 9.0, 8)])


def faced(pose, lines):
    """Return lines as seen from a pose, by their definition."""
    normals = np.column_stack([np.cos(lines[:, 0]), np.sin(lines[:, 0])])
    distances = lines[:, 1] - normals @ [pose.x_m, pose.y_m]
    return np.column_stack([lines[:, 0] - pose.theta_rad, distances])


def driven(seed, sigma_rad, *, known=True):
    """Drive twice round in a room; return the true pose and the filter."""
    rng = np.random.default_rng(seed)
    lines, pose = walls(rng), SE2()
    start = np.diag([0.01, 0.01, sigma_rad**2])
    slam = EkfSlam(np.sqrt(np.diag(start)) * rng.standard_normal(3), start)
    for _ in range(100):
        d, a = 0.25, 0.12
        spread = math.sqrt(NOISE.f_rad_per_sqrt_m**2 * d + NOISE.g_rad_per_sqrt_rad**2 * a)
        along = NOISE.e_m_per_sqrt_m * math.sqrt(d) * rng.standard_normal()
        pose = arc(pose, d + along, a + spread * rng.standard_normal())
        slam.move(d, a, NOISE)
        near = rng.choice(len(lines), 3, replace=False)
        z = faced(pose, lines[near]) + rng.standard_normal((3, 2)) @ np.sqrt(R)
        noises = np.tile(R, (3, 1, 1))
        if known:
            slam.sight(LINE, near.tolist(), z, noises)
            continue
        which = slam.associate(LINE, z, noises)
        if np.any(which >= 0):
            slam.update(LINE, which[which >= 0], z[which >= 0], noises[which >= 0])
        for row in np.flatnonzero(which == NEW):
            slam.add(LINE, len(slam.names), z[row], R)
    return pose, slam


def test_a_line_is_expected_where_its_definition_has_it_and_new_where_it_is_seen():
    lines = walls(np.random.default_rng(0))
    x_v = np.array([1.0, -2.0, 0.7])
    z, by_robot, by_line = LINE.expected(x_v, lines)
    seen = faced(SE2(*x_v), lines)
    assert LINE.residual(seen, z) == pytest.approx(np.zeros_like(z), abs=1e-12)
    assert LINE.initial(x_v, z[3])[1] == pytest.approx(lines[3, 1])
    for k in range(3):
        step = np.zeros(3)
        step[k] = 1e-6
        moved = LINE.residual(LINE.expected(x_v + step, lines)[0], z) / 1e-6
        assert by_robot[:, :, k] == pytest.approx(moved, abs=1e-5)
    for k in range(2):
        other = lines.copy()
        other[:, k] += 1e-6
        moved = LINE.residual(LINE.expected(x_v, other)[0], z) / 1e-6
        assert by_line[:, :, k] == pytest.approx(moved, abs=1e-5)


@pytest.mark.parametrize("sigma_rad", [0.001, 0.3])
def test_it_is_as_sure_of_the_pose_as_it_may_be_also_of_one_that_is_far_off(sigma_rad):
    low, high = (bound / SEEDS for bound in chi2_bounds(3 * SEEDS))
    nees = [slam.nees(pose) for pose, slam in (driven(seed, sigma_rad) for seed in range(SEEDS))]
    assert low < np.mean(nees) < high


def test_walls_are_told_apart_without_names():
    pose, slam = driven(0, 0.001, known=False)
    assert len(slam.names) == 8
    assert slam.nees(pose) < 16.3  # one in a thousand
