"""Local maps that are joined: what one filter of all says, consistently."""

import math

import numpy as np
import pytest

from robotctl.estimation.kalman.chi_squared import chi2_bounds
from robotctl.estimation.slam.ekf_slam.features import POINT
from robotctl.estimation.slam.ekf_slam.filter import EkfSlam, tangent_nees
from robotctl.estimation.slam.ekf_slam.joined_maps import JoinedMaps
from robotctl.model.drives.motion import arc
from robotctl.model.drives.motion_noise import MotionNoise
from robotctl.model.geometry.se2 import SE2

pytestmark = pytest.mark.timeout(600)  # the first of them compiles
NOISE = MotionNoise(0.02, 0.02, 0.03)
R = np.diag([0.05**2, 0.02**2])
SEEDS = 12


def driven(seed, most_features, *, exact=False):
    """Drive once round among points; return the true pose, the filter and the joined maps."""
    rng = np.random.default_rng(seed)
    scale = 0.01 if exact else 1.0  # small errors: all is linear
    noise = MotionNoise(*(scale * each for each in (0.02, 0.02, 0.03)))
    noise_z = scale**2 * R
    points = rng.uniform(-5.0, 13.0, (40, 2))
    maps = JoinedMaps(most_features)
    whole, local, pose = EkfSlam(np.zeros(3), np.zeros((3, 3))), maps.begin(), SE2()
    for _ in range(110):
        d, a = 0.25, 0.06
        spread = math.sqrt(noise.f_rad_per_sqrt_m**2 * d + noise.g_rad_per_sqrt_rad**2 * a)
        along = noise.e_m_per_sqrt_m * math.sqrt(d) * rng.standard_normal()
        pose = arc(pose, d + along, a + spread * rng.standard_normal())
        dx, dy = (points - [pose.x_m, pose.y_m]).T
        z = np.stack([np.hypot(dx, dy), np.arctan2(dy, dx) - pose.theta_rad], axis=1)
        near = np.flatnonzero(z[:, 0] < 5.0)
        z = z[near] + rng.standard_normal((len(near), 2)) @ np.sqrt(noise_z)
        for each in (local, whole):
            each.move(d, a, noise)
            each.sight(POINT, near.tolist(), z, np.tile(noise_z, (len(near), 1, 1)))
        if maps.is_full(local):
            local = maps.join(local)
    maps.join(local)
    return pose, whole, maps


def test_joined_maps_are_the_map_of_one_filter_where_all_is_linear():
    _, whole, maps = driven(0, 15, exact=True)
    assert sorted(maps.names) == sorted(whole.names)
    pose = whole.pose
    assert maps.belief.x[:3] == pytest.approx([pose.x_m, pose.y_m, maps.belief.x[2]], abs=2e-4)
    assert maps.belief.covariance()[:3, :3] == pytest.approx(
        whole.pose_covariance(), rel=0.02, abs=1e-10
    )
    for number, name in enumerate(whole.names):
        place, P = maps.feature(name)
        assert place == pytest.approx(whole.features[number], abs=2e-4)
        assert pytest.approx(whole.covariance(number), rel=0.03, abs=1e-10) == P


def test_they_are_as_sure_as_they_may_be():
    low, high = (bound / SEEDS for bound in chi2_bounds(3 * SEEDS))
    nees = []
    for seed in range(SEEDS):
        truth, _, maps = driven(seed, 25)
        nees.append(tangent_nees(maps.base, maps.belief.covariance()[:3, :3], truth))
    assert low < np.mean(nees) < high


def test_a_place_seen_from_two_local_maps_is_one_place():
    maps = JoinedMaps()
    local = maps.begin()
    for x in (4.0, 3.0):
        local.sight(POINT, ["tree"], np.array([[x, 0.0]]), R[None])
        local.remember(x)
        local.move(1.0, 0.0, NOISE)
        local = maps.join(local)
    assert maps.names.count("tree") == 1
    assert maps.feature("tree")[0] == pytest.approx([4.0, 0.0], abs=1e-6)
    assert maps.past(3.0)[0].x_m == pytest.approx(1.0, abs=1e-6)
    assert maps.base.x_m == pytest.approx(2.0, abs=1e-6)
