"""Measurement models of the EKF: Jacobians against numerical ones, ranges against geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.estimation.kalman.ekf_config import EkfConfig
from robotctl.estimation.kalman.ekf_models import landmark_sighting, wall_range
from robotctl.estimation.kalman.ekf_motion import coasted, moved
from robotctl.estimation.ranging.sonar_config import SonarModelConfig
from robotctl.model.drives.motion import arc
from robotctl.model.drives.motion_noise import MotionNoise
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount
from robotctl.model.wall_map import WallMap

angles = st.floats(-3.0, 3.0)
places = st.floats(-1.5, 1.5)
THIN_DEG = 1e-9
RAY = SonarModelConfig(beam_deg=THIN_DEG, max_incidence_deg=80.0)
ROOM = WallMap(
    np.array([[-2, -2, 2, -2], [2, -2, 2.5, 2], [2.5, 2, -2, 2], [-2, 2, -2, -2]], dtype=float)
)


def numerical(function, x, step=1e-6):
    """Jacobian by central differences, (m, n)."""
    columns = []
    for i in range(len(x)):
        up, down = np.array(x, dtype=float), np.array(x, dtype=float)
        up[i] += step
        down[i] -= step
        columns.append((np.asarray(function(up)) - np.asarray(function(down))) / (2.0 * step))
    return np.stack(columns, axis=-1)


@given(x=places, y=places, theta=angles)
def test_the_jacobian_of_a_landmark_sighting_is_the_numerical_one(x, y, theta):
    landmark = (2.0, 3.0)
    _, H = landmark_sighting(SE2(x, y, theta), landmark)
    expected = numerical(lambda p: landmark_sighting(SE2(*p), landmark)[0], [x, y, theta])
    np.testing.assert_allclose(H, expected, atol=1e-6)


@given(x=places, y=places, theta=angles, beam_deg=st.sampled_from([THIN_DEG, 15.0]))
def test_the_jacobian_of_a_wall_range_is_the_numerical_one(x, y, theta, beam_deg):
    mount = SonarMount("left", 0.12, 0.08, 35.0)
    beam = SonarModelConfig(beam_deg=beam_deg, max_incidence_deg=80.0)
    found = wall_range(SE2(x, y, theta), mount, ROOM, beam)
    assert found is not None
    m, H = found

    def measured(p):
        again = wall_range(SE2(*p), mount, ROOM, beam)
        assert again is not None
        return again[0]

    forward = np.array([measured(p) - m for p in 1e-6 * np.eye(3) + [x, y, theta]])
    backward = np.array([m - measured(p) for p in -1e-6 * np.eye(3) + [x, y, theta]])
    smooth = np.abs(forward - backward) < 1e-9  # not where another wall becomes the nearest
    np.testing.assert_allclose(
        H[smooth], (forward + backward)[smooth] / 2e-6, atol=1e-4 * max(1.0, m)
    )


@given(theta=st.floats(-0.7, 0.7), distance=st.floats(0.3, 1.4))
def test_a_ray_reads_the_distance_over_the_cosine(theta, distance):
    wall = WallMap(np.array([[distance, -9.0, distance, 9.0]]))
    found = wall_range(SE2(0.0, 0.0, theta), SonarMount("front", 0.0, 0.0, 0.0), wall, RAY)
    assert found is not None
    assert found[0] == pytest.approx(distance / math.cos(theta))


def test_a_cone_reads_the_perpendicular_while_it_holds_it_and_its_edge_beyond():
    wall = WallMap(np.array([[1.0, -9.0, 1.0, 9.0]]))
    front = SonarMount("front", 0.0, 0.0, 0.0)
    cone = SonarModelConfig(beam_deg=30.0, max_incidence_deg=40.0)
    inside = wall_range(SE2(0.0, 0.0, math.radians(14.0)), front, wall, cone)
    beyond = wall_range(SE2(0.0, 0.0, math.radians(30.0)), front, wall, cone)
    assert inside is not None
    assert beyond is not None
    assert inside[0] == pytest.approx(1.0)
    assert inside[1][2] == pytest.approx(0.0)
    assert beyond[0] == pytest.approx(1.0 / math.cos(math.radians(15.0)))


def test_the_nearest_wall_answers_from_either_side_and_those_behind_do_not():
    far, near, behind = [3.0, -1.0, 3.0, 1.0], [2.0, 1.0, 2.0, -1.0], [-1.0, -1.0, -1.0, 1.0]
    found = wall_range(
        SE2(), SonarMount("front", 0.0, 0.0, 0.0), WallMap(np.array([far, behind, near])), RAY
    )
    assert found is not None
    assert found[0] == pytest.approx(2.0)


def test_a_wall_met_too_flatly_or_beside_its_ends_or_parallel_sends_nothing():
    front = SonarMount("front", 0.0, 0.0, 0.0)
    beam = SonarModelConfig(beam_deg=THIN_DEG, max_incidence_deg=25.0)
    slanted = WallMap(np.array([[1.0, -1.0, 3.0, 1.0]]))
    beside = WallMap(np.array([[1.0, 0.5, 1.0, 2.0]]))
    parallel = WallMap(np.array([[0.5, 0.0, 2.0, 0.0], [0.0, 1.0, 2.0, 1.0]]))
    for walls in (slanted, beside, parallel):
        assert wall_range(SE2(), front, walls, beam) is None


def test_a_flat_wall_hides_the_good_one_behind_it():
    walls = WallMap(np.array([[1.0, -1.0, 3.0, 1.0], [4.0, -2.0, 4.0, 2.0]]))
    beam = SonarModelConfig(beam_deg=THIN_DEG, max_incidence_deg=25.0)
    assert wall_range(SE2(), SonarMount("front", 0.0, 0.0, 0.0), walls, beam) is None


CONFIG = EkfConfig(
    motion=MotionNoise(0.05, 0.07, 0.09),
    velocity_sigma_m_s=1e-6,
    turn_rate_sigma_rad_s=1e-6,
    gyro=True,
)


@given(theta=angles, d=st.floats(-0.5, 0.5), alpha=st.floats(-2.5, 2.5))
def test_the_jacobian_of_a_counted_motion_is_the_numerical_one(theta, d, alpha):
    x = np.array([0.3, -0.2, theta, 0.4, 0.1, 0.02])
    _, F, _ = moved(x, d, alpha, 0.1, CONFIG)

    def unwrapped(p):
        after = moved(p, d, alpha, 0.1, CONFIG)[0]
        after[2] = p[2] + alpha
        return after

    np.testing.assert_allclose(F, numerical(unwrapped, x), atol=1e-6)


@given(theta=angles, v=st.floats(-2.0, 2.0), omega=st.floats(-3.0, 3.0))
def test_the_jacobian_of_coasting_is_the_numerical_one(theta, v, omega):
    x = np.array([0.3, -0.2, theta, v, omega, 0.02])
    _, F, _ = coasted(x, 0.3, CONFIG)

    def unwrapped(p):
        after = coasted(p, 0.3, CONFIG)[0]
        after[2] = p[2] + p[4] * 0.3
        return after

    np.testing.assert_allclose(F, numerical(unwrapped, x), atol=1e-5)


@given(theta=angles, d=st.floats(-0.5, 0.5), alpha=st.floats(-2.5, 2.5))
def test_noise_joins_pose_and_velocities_as_the_arc_does_and_stays_a_covariance(theta, d, alpha):
    dt_s = 0.1
    Q = moved(np.array([0.0, 0.0, theta, 0.0, 0.0, 0.0]), d, alpha, dt_s, CONFIG)[2]
    scale = np.array([1.0, 1.0, 1.0, dt_s, dt_s, 1.0])
    assert np.linalg.eigvalsh(Q * np.outer(scale, scale)).min() > -1e-12

    def end(p):
        pose = arc(SE2(0.0, 0.0, theta), p[0], p[1])
        return pose.x_m, pose.y_m

    by_arc = numerical(end, [d, alpha])
    noise = CONFIG.motion
    along = noise.e_m_per_sqrt_m**2 * abs(d)
    turning = noise.f_rad_per_sqrt_m**2 * abs(d) + noise.g_rad_per_sqrt_rad**2 * abs(alpha)
    np.testing.assert_allclose(Q[:2, 3] * dt_s, along * by_arc[:, 0], atol=2e-7)
    np.testing.assert_allclose(Q[:2, 4] * dt_s, turning * by_arc[:, 1], atol=2e-7)
