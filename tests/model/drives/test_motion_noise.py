"""Motion noise: composition laws, closed forms, and seeded Monte Carlo runs as oracle."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.model.drives.motion import arc
from robotctl.model.drives.motion_noise import (
    MotionNoise,
    added_covariance,
    pose_jacobian,
    propagate,
)
from robotctl.model.geometry.se2 import SE2

NOISE = MotionNoise(0.02, 0.03, 0.04)
distances = st.floats(-3.0, 3.0)
angles = st.floats(-6.0, 6.0)
poses = st.builds(SE2, distances, distances, st.floats(-3.0, 3.0))
P0 = np.array([[0.04, 0.01, 0.002], [0.01, 0.09, -0.003], [0.002, -0.003, 0.01]])


def test_the_variance_along_and_of_the_heading_grows_with_distance():
    Q = added_covariance(SE2(), 4.0, 0.0, NOISE)
    assert Q[0, 0] == pytest.approx(0.02**2 * 4.0)
    assert Q[2, 2] == pytest.approx(0.03**2 * 4.0)


def test_a_heading_that_wanders_moves_the_robot_sideways_with_the_cube_of_the_distance():
    """Integrated white noise: variance f^2 d^3 / 3, covariance with the heading f^2 d^2 / 2."""
    Q = added_covariance(SE2(), 4.0, 0.0, NOISE)
    assert Q[1, 1] == pytest.approx(0.03**2 * 4.0**3 / 3)
    assert Q[1, 2] == pytest.approx(0.03**2 * 4.0**2 / 2)


def test_a_turn_on_the_spot_touches_the_heading_alone():
    Q = added_covariance(SE2(1.0, 2.0, 0.5), 0.0, -2.5, NOISE)
    expected = np.zeros((3, 3))
    expected[2, 2] = 0.04**2 * 2.5
    np.testing.assert_allclose(Q, expected, atol=1e-15)


@given(poses, distances, angles, st.integers(2, 7))
def test_a_motion_in_parts_has_the_covariance_of_the_whole(pose, distance, angle, n):
    P, at = P0, pose
    for _ in range(n):
        P = propagate(P, at, distance / n, angle / n, NOISE)
        at = arc(at, distance / n, angle / n)
    np.testing.assert_allclose(P, propagate(P0, pose, distance, angle, NOISE), atol=1e-10)


def test_many_steps_of_the_notes_approach_it():
    """The notes' own step, x + (D + e) cos(theta), theta + f, in n parts."""

    def notes(n: int) -> np.ndarray:
        P, at, d = P0.copy(), SE2(0.0, 0.0, 0.7), 2.0 / n
        for _ in range(n):
            c, s = math.cos(at.theta_rad), math.sin(at.theta_rad)
            F = np.array([[1, 0, -d * s], [0, 1, d * c], [0, 0, 1]])
            along = 0.02**2 * d * np.outer([c, s, 0], [c, s, 0])
            P = F @ P @ F.T + along + np.diag([0, 0, 0.03**2 * d])
            at = arc(at, d, 0.0)
        return P

    exact = propagate(P0, SE2(0.0, 0.0, 0.7), 2.0, 0.0, NOISE)
    errors = [np.abs(notes(n) - exact).max() for n in (1, 10, 100, 1000)]
    assert errors == sorted(errors, reverse=True)
    assert errors[3] < 2e-3 * errors[0]


@given(poses, distances, angles)
def test_covariances_stay_symmetric_and_positive(pose, distance, angle):
    P = propagate(P0, pose, distance, angle, NOISE)
    np.testing.assert_array_equal(P, P.T)
    assert np.linalg.eigvalsh(P).min() > 0


@given(poses, distances, angles)
def test_the_pose_jacobian_agrees_with_differences(pose, distance, angle):
    h = 1e-6
    columns = []
    for i in range(3):
        values = []
        for sign in (1, -1):
            start = [pose.x_m, pose.y_m, pose.theta_rad]
            start[i] += sign * h
            end = arc(SE2(*start), distance, angle)
            values.append(np.array([end.x_m, end.y_m, end.theta_rad]))
        difference = values[0] - values[1]
        difference[2] = math.remainder(difference[2], math.tau)
        columns.append(difference / (2 * h))
    np.testing.assert_allclose(
        pose_jacobian(pose, distance, angle), np.stack(columns, axis=1), atol=1e-7
    )


@pytest.mark.parametrize(
    ("distance", "angle"), [(3.0, 0.0), (3.0, 2.0), (-2.0, -4.0), (0.0, 3.0), (2.0, 1e-9)]
)
def test_simulated_robots_scatter_as_predicted(distance, angle):
    noise = MotionNoise(0.02, 0.015, 0.012)
    rng = np.random.default_rng(7)
    runs, steps = 20_000, 100
    start = np.array([1.0, 2.0, 0.8])
    L = np.linalg.cholesky(0.01 * P0)
    x, y, theta = (start[:, None] + L @ rng.standard_normal((3, runs)))[:]
    d, a = distance / steps, angle / steps
    along = noise.e_m_per_sqrt_m * math.sqrt(abs(d))
    turning = math.sqrt(noise.f_rad_per_sqrt_m**2 * abs(d) + noise.g_rad_per_sqrt_rad**2 * abs(a))
    for _ in range(steps):
        step_d = d + along * rng.standard_normal(runs)
        step_a = a + turning * rng.standard_normal(runs)
        x += step_d * np.cos(theta + 0.5 * step_a)
        y += step_d * np.sin(theta + 0.5 * step_a)
        theta += step_a
    sample = np.cov(np.stack([x, y, theta]))
    expected = propagate(0.01 * P0, SE2(*start), distance, angle, noise)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    # one standard error of a covariance of 20000 runs is at most sqrt(2/20000) = 1 %
    np.testing.assert_allclose(sample / scale, expected / scale, atol=0.05)


@pytest.mark.parametrize("value", [-0.1, math.nan, math.inf])
def test_a_noise_that_is_no_deviation_is_refused(value):
    with pytest.raises(ValueError, match="f_rad_per_sqrt_m"):
        MotionNoise(0.01, value, 0.01)


def test_the_greater_of_two_noises_is_taken_noise_by_noise():
    found = MotionNoise(0.01, 0.05, 0.02).at_least(MotionNoise(0.03, 0.04, 0.02))
    assert found == MotionNoise(0.03, 0.05, 0.02)
