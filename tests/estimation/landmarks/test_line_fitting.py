"""Lines and corners: closed forms, numerical derivatives, symmetry, and honest covariances."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from robotctl.estimation.kalman.chi_squared import chi2_bounds
from robotctl.estimation.landmarks.line_fitting import BeamNoise, Line, fit_line, intersection
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2

NOISE = BeamNoise(0.01, 0.005, 0.003)
ANGLES = st.floats(-3.1, 3.1)


def wall(alpha: float, r_m: float, n: int = 30, half_m: float = 1.0, shift_m: float = 0.2):
    """Ranges and bearings of exact points on a line."""
    along = np.linspace(shift_m - half_m, shift_m + half_m, n)
    normal = np.array([math.cos(alpha), math.sin(alpha)])
    at = r_m * normal + np.outer(along, [-normal[1], normal[0]])
    return np.hypot(*at.T), np.arctan2(at[:, 1], at[:, 0])


def points(ranges, angles):
    return np.stack([ranges * np.cos(angles), ranges * np.sin(angles)], axis=1)


def fitted(ranges, angles, noise=NOISE) -> Line:
    return fit_line(points(ranges, angles), noise.covariances(ranges, angles))


@given(ANGLES, st.floats(0.05, 5.0))
def test_exact_points_give_their_line(alpha, r_m):
    line = fitted(*wall(alpha, r_m))
    assert line.r_m == pytest.approx(r_m, abs=1e-9)
    assert wrap_angle(line.alpha_rad - alpha) == pytest.approx(0.0, abs=1e-9)
    assert line.chi2 == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_no_other_line_has_less_weighted_squares(seed):
    rng = np.random.default_rng(seed)
    at = rng.normal(size=(12, 2)) * (1.0, 0.2) + rng.uniform(-2.0, 2.0, 2)
    sigmas = rng.uniform(0.1, 0.5, 12)
    line = fit_line(at, sigmas[:, None, None] ** 2 * np.eye(2))

    def cost(p):
        return np.sum(((at @ [math.cos(p[0]), math.sin(p[0])] - p[1]) / sigmas) ** 2)

    starts = [(a, 0.0) for a in np.linspace(-math.pi, math.pi, 9)]
    best = min(minimize(cost, start, tol=1e-12).fun for start in starts)
    assert line.chi2 == pytest.approx(best, rel=1e-6)


def test_the_covariance_of_a_wall_straight_ahead_is_that_of_linear_regression():
    # Points (r, y_i) with noise along x alone: x = r - alpha y is an ordinary regression.
    y = np.linspace(-0.7, 1.3, 15)
    at = np.stack([np.full(15, 2.0), y], axis=1)
    covariances = np.tile(np.diag([0.02**2, 1e-18]), (15, 1, 1))
    line = fit_line(at, covariances)
    design = np.stack([-y, np.ones(15)], axis=1)
    wanted = 0.02**2 * np.linalg.inv(design.T @ design)
    np.testing.assert_allclose(line.covariance, wanted, rtol=1e-6)


@settings(max_examples=25)
@given(ANGLES, st.floats(0.3, 3.0), st.integers(0, 1000))
def test_the_covariance_is_that_of_numerical_derivatives(alpha, r_m, seed):
    rng = np.random.default_rng(seed)
    ranges, angles = wall(alpha, r_m, 9)
    ranges = ranges + 0.01 * rng.standard_normal(9)
    at, covariances = points(ranges, angles), NOISE.covariances(ranges, angles)
    line = fit_line(at, covariances)
    wanted = np.zeros((2, 2))
    for i in range(9):
        columns = []
        for axis in range(2):
            step = np.zeros_like(at)
            step[i, axis] = 1e-6
            more, less = fit_line(at + step, covariances), fit_line(at - step, covariances)
            turn = wrap_angle(more.alpha_rad - less.alpha_rad)
            columns.append([turn / 2e-6, (more.r_m - less.r_m) / 2e-6])
        jacobian = np.array(columns).T
        wanted += jacobian @ covariances[i] @ jacobian.T
    # The weights hang on the direction, by noise alone: that is left out of the derivative.
    np.testing.assert_allclose(line.covariance, wanted, rtol=0.05, atol=0.02 * wanted.max())


def test_errors_are_as_large_as_the_covariance_says():
    rng = np.random.default_rng(2)
    ranges, angles = wall(2.4, 1.5, 25)
    nees, chi2 = [], []
    for _ in range(600):
        seen = ranges + (NOISE.sigma_m + NOISE.sigma_per_m * ranges) * rng.standard_normal(25)
        line = fitted(seen, angles + NOISE.bearing_sigma_rad * rng.standard_normal(25))
        error = np.array([wrap_angle(line.alpha_rad - 2.4), line.r_m - 1.5])
        nees.append(error @ np.linalg.solve(line.covariance, error))
        chi2.append(line.chi2)
    for values, dof in ((nees, 2), (chi2, 23)):
        low, high = chi2_bounds(600 * dof, 0.999)
        assert low < sum(values) < high


@given(ANGLES, st.floats(0.5, 3.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), ANGLES)
def test_a_line_moves_with_its_points(alpha, r_m, x_m, y_m, theta):
    rng = np.random.default_rng(3)
    ranges, angles = wall(alpha, r_m, 12)
    ranges = ranges + 0.01 * rng.standard_normal(12)
    at, covariances = points(ranges, angles), NOISE.covariances(ranges, angles)
    before = fit_line(at, covariances)
    turn = np.array([[math.cos(theta), -math.sin(theta)], [math.sin(theta), math.cos(theta)]])
    after = fit_line(at @ turn.T + [x_m, y_m], turn @ covariances @ turn.T)
    # n.p = r becomes (T n).q = r + (T n).t; the covariance follows by the same map.
    normal = turn @ before.normal
    r = before.r_m + float(normal @ [x_m, y_m])
    sign = 1.0 if r >= 0.0 else -1.0
    np.testing.assert_allclose(after.normal, sign * normal, atol=1e-9)
    assert after.r_m == pytest.approx(sign * r, abs=1e-9)
    jacobian = np.array(
        [[1.0, 0.0], [sign * float(np.array([-normal[1], normal[0]]) @ [x_m, y_m]), sign]]
    )
    wanted = jacobian @ before.covariance @ jacobian.T
    np.testing.assert_allclose(after.covariance, wanted, rtol=1e-6, atol=1e-12)
    assert after.chi2 == pytest.approx(before.chi2, rel=1e-6)


@given(ANGLES, st.floats(0.6, 2.5), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_lines_meet_at_their_corner(alpha, turn, x_m, y_m):
    lines = []
    for direction in (alpha, alpha + turn):
        r = x_m * math.cos(direction) + y_m * math.sin(direction)
        if r < 0.0:
            direction, r = direction + math.pi, -r  # noqa: PLW2901
        lines.append(Line(wrap_angle(direction), r, np.diag([1e-4, 1e-4]), 0.0, 2))
    corner = intersection(*lines)
    np.testing.assert_allclose(corner.position, [x_m, y_m], atol=1e-9)
    wanted = np.zeros((2, 2))
    for i, line in enumerate(lines):
        for step in ((1e-6, 0.0), (0.0, 1e-6)):
            other = Line(line.alpha_rad + step[0], line.r_m + step[1], line.covariance, 0.0, 2)
            pair = [other if j == i else each for j, each in enumerate(lines)]
            by = (intersection(*pair).position - corner.position) / 1e-6
            wanted += 1e-4 * np.outer(by, by)
    np.testing.assert_allclose(corner.covariance, wanted, rtol=1e-3, atol=1e-8)


def test_corners_err_as_much_as_their_covariance_says():
    rng = np.random.default_rng(4)
    truth = SE2(1.2, 0.8, 0.0)
    nees = []
    for _ in range(500):
        lines = []
        for normal, along in (((1.0, 0.0), (0.0, -1.0)), ((0.0, 1.0), (-1.0, 0.0))):
            way = np.linspace(0.05, 1.5, 20)
            at = np.array([truth.x_m, truth.y_m]) + np.outer(way, along)
            ranges, angles = np.hypot(*at.T), np.arctan2(at[:, 1], at[:, 0])
            sigma = NOISE.sigma_m + NOISE.sigma_per_m * ranges
            lines.append(
                fitted(
                    ranges + sigma * rng.standard_normal(20),
                    angles + NOISE.bearing_sigma_rad * rng.standard_normal(20),
                )
            )
            np.testing.assert_allclose(lines[-1].normal, normal, atol=0.1)
        corner = intersection(*lines)
        error = corner.position - [truth.x_m, truth.y_m]
        nees.append(error @ np.linalg.solve(corner.covariance, error))
    low, high = chi2_bounds(500 * 2, 0.999)
    assert low < sum(nees) < high


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: BeamNoise(0.0), "sigma_m"),
        (lambda: BeamNoise(0.1, -0.1), "sigma_per_m"),
        (lambda: BeamNoise(0.1, 0.0, math.inf), "bearing_sigma_rad"),
        (lambda: fit_line(np.zeros((1, 2)), np.ones((1, 2, 2))), "n >= 2"),
        (lambda: fit_line(np.zeros((3, 2)), np.ones((2, 2, 2))), r"\(n, 2, 2\)"),
        (lambda: fit_line(np.full((3, 2), np.inf), np.tile(np.eye(2), (3, 1, 1))), "finite"),
        (lambda: fit_line(np.ones((3, 2)), np.tile(np.eye(2), (3, 1, 1))), "equally"),
        (
            lambda: fit_line(
                np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]),
                np.tile(np.eye(2), (4, 1, 1)),
            ),
            "equally",
        ),
        (
            lambda: intersection(
                Line(0.0, 1.0, np.eye(2), 0.0, 2), Line(math.pi, 2.0, np.eye(2), 0.0, 2)
            ),
            "parallel",
        ),
    ],
)
def test_what_has_no_line_is_refused(make, word):
    with pytest.raises(ValueError, match=word):
        make()
