"""Motion of particles: the variance laws of `motion_noise.py`; exact without noise."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.estimation.mcl.particle_motion import OdometrySegment, ParticleMotionConfig
from robotctl.estimation.mcl.particles import weighted_covariance
from robotctl.model.drives.motion import arc
from robotctl.model.drives.motion_noise import MotionNoise, propagate
from robotctl.model.geometry.se2 import SE2

NOISE = MotionNoise(0.02, 0.03, 0.04)
TINY = 1e-9
QUIET = ParticleMotionConfig(MotionNoise(0.0, 0.0, 0.0), TINY, TINY)
distances = st.floats(-2.0, 2.0)
angles = st.floats(-3.0, 3.0)
poses = st.builds(SE2, distances, distances, angles)


def way_of(config: ParticleMotionConfig, *arcs: tuple[float, float]) -> OdometrySegment:
    way = OdometrySegment(config)
    for distance, angle in arcs:
        way.add(arc(SE2(), distance, angle))
    return way


@given(poses, st.lists(st.tuples(distances, angles), min_size=1, max_size=5))
def test_the_covariance_of_a_way_of_arcs_is_that_of_the_motion_noise(pose, arcs):
    way = way_of(ParticleMotionConfig(NOISE), *arcs)
    at, expected = pose, np.zeros((3, 3))
    for distance, angle in arcs:
        expected = propagate(expected, at, distance, angle, NOISE)
        at = arc(at, distance, angle)
    end, covariance = way.end(pose, np.zeros((3, 3)))
    np.testing.assert_allclose(covariance, expected, atol=1e-9)
    assert (end.x_m, end.y_m) == pytest.approx((at.x_m, at.y_m), abs=1e-9)
    assert math.cos(end.theta_rad - at.theta_rad) == pytest.approx(1.0)


@settings(deadline=None, max_examples=20)
@given(poses, distances, angles)
def test_particles_spread_as_the_motion_noise_says(pose, distance, angle):
    """A seeded sample of 20000: standard errors of its variances are 1 %."""
    way = way_of(ParticleMotionConfig(NOISE, 0.01, 0.02), (distance, angle))
    start = np.tile((pose.x_m, pose.y_m, pose.theta_rad), (20_000, 1))
    moved = way.moved(start, np.random.default_rng(1))
    Q = propagate(np.zeros((3, 3)), pose, distance, angle, NOISE) + np.diag([1e-4, 1e-4, 4e-4])
    end = arc(pose, distance, angle)
    found = weighted_covariance(moved, np.full(len(moved), 1 / len(moved)), end)
    scale = np.sqrt(np.outer(np.diag(Q), np.diag(Q)))
    np.testing.assert_allclose(found / scale, Q / scale, atol=0.06)


@pytest.mark.parametrize("parts", [1, 4])
def test_variances_grow_with_distance_and_angle_however_the_way_is_cut(parts):
    straight = way_of(ParticleMotionConfig(NOISE), *[(4.0 / parts, 0.0)] * parts).covariance
    assert straight[0, 0] == pytest.approx(NOISE.e_m_per_sqrt_m**2 * 4.0)
    assert straight[2, 2] == pytest.approx(NOISE.f_rad_per_sqrt_m**2 * 4.0)
    turn = way_of(ParticleMotionConfig(NOISE), *[(0.0, 2.0 / parts)] * parts).covariance
    assert turn[2, 2] == pytest.approx(NOISE.g_rad_per_sqrt_rad**2 * 2.0)


@given(poses, distances, angles)
def test_without_noise_every_particle_makes_the_motion(pose, distance, angle):
    start = np.array([[pose.x_m, pose.y_m, pose.theta_rad], [0.0, 0.0, 3.0]])
    moved = way_of(QUIET, (distance, angle)).moved(start, np.random.default_rng(0))
    for before, after in zip(start, moved, strict=True):
        end = arc(SE2(*before), distance, angle)
        assert after[:2] == pytest.approx((end.x_m, end.y_m), abs=1e-7)
        assert math.cos(after[2] - end.theta_rad) == pytest.approx(1.0)
        assert -math.pi <= after[2] <= math.pi


def test_a_sideways_motion_is_taken_as_it_is():
    """Corrected poses in logs, and drives on slippery floors, slide."""
    way = OdometrySegment(QUIET)
    way.add(SE2(0.0, 0.5, 0.2))
    moved = way.moved(np.array([[1.0, 2.0, math.pi / 2]]), np.random.default_rng(0))
    np.testing.assert_allclose(moved[0], [0.5, 2.0, math.pi / 2 + 0.2], atol=1e-7)


def test_forth_and_back_adds_up_the_way_though_the_pose_returns():
    way = way_of(ParticleMotionConfig(NOISE), (1.0, 0.0), (-1.0, 0.0), (0.0, 0.5), (0.0, -0.5))
    assert (way.distance_m, way.angle_rad) == pytest.approx((2.0, 1.0))
    assert way.motion.x_m == pytest.approx(0.0, abs=1e-12)
    assert way.covariance[0, 0] == pytest.approx(NOISE.e_m_per_sqrt_m**2 * 2.0)


def test_standing_still_adds_nothing_to_the_way():
    way = way_of(ParticleMotionConfig(NOISE), (0.0, 0.0))
    assert not way.covariance.any()
    assert way.distance_m == 0.0


@pytest.mark.parametrize("key", ["floor_m", "floor_rad"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_a_floor_out_of_range_is_refused(key, value):
    with pytest.raises(ValueError, match=key):
        ParticleMotionConfig(**{key: value})
