"""Tempering and annealing: the effective size that they keep, and the posterior that they reach."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.estimation.mcl.annealing import anneal
from robotctl.estimation.mcl.particles import effective_size, weighted_covariance, weighted_mean
from robotctl.estimation.mcl.pose_bins import BinSize
from robotctl.estimation.mcl.sliced import at_once
from robotctl.estimation.mcl.tempering import bearable_exponent
from robotctl.estimation.ranging.log_likelihood import LogLikelihood, evaluated

N = 20_000
ALIKE = np.full(N, 1 / N)


def tempered(weights: np.ndarray, logs: np.ndarray, exponent: float) -> np.ndarray:
    result = weights * np.exp(exponent * (logs - logs.max()))
    return result / result.sum()


@given(st.integers(0, 2**32 - 1), st.floats(0.01, 300.0), st.floats(0.02, 0.9))
def test_the_exponent_keeps_the_effective_size_and_hardly_more(seed, scale, floor):
    rng = np.random.default_rng(seed)
    logs, weights = rng.normal(size=200) * scale, np.full(200, 1 / 200)
    exponent = bearable_exponent(weights, logs, floor * 200)
    assert 0.0 < exponent <= 1.0
    if exponent > 1 / 4096:
        assert effective_size(tempered(weights, logs, exponent)) >= floor * 200 - 1e-9
    if exponent < 1.0:
        more = tempered(weights, logs, exponent + 1 / 4096)
        kept = effective_size(tempered(weights, logs, exponent))
        assert kept <= 1.05 * floor * 200 + 1e-9 or effective_size(more) < floor * 200


def test_a_mild_likelihood_is_taken_whole():
    logs = np.linspace(-1.0, 0.0, 100)
    assert bearable_exponent(np.full(100, 0.01), logs, 50.0) == 1.0


def test_an_impossible_pose_does_not_hinder():
    logs = np.array([0.0, -math.inf, 0.0, 0.0])
    assert bearable_exponent(np.full(4, 0.25), logs, 2.5) == 1.0


def peak(x: float, y: float, theta: float, sigma_m: float, sigma_rad: float):
    def log_likelihood(poses: np.ndarray) -> np.ndarray:
        dx, dy = poses[:, 0] - x, poses[:, 1] - y
        turn = np.angle(np.exp(1j * (poses[:, 2] - theta)))
        return -0.5 * ((dx**2 + dy**2) / sigma_m**2 + (turn / sigma_rad) ** 2)

    return log_likelihood


def anywhere(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform((-10, -10, -math.pi), (10, 10, math.pi), (N, 3))


def annealed(of: int, log_likelihood: LogLikelihood, seed: int, count: int = N):
    poses, rng = anywhere(of), np.random.default_rng(seed)
    logs = evaluated(log_likelihood, poses)
    return at_once(anneal(poses, ALIKE, logs, log_likelihood, count, BinSize(), 0.3, rng))


def test_a_peak_far_narrower_than_the_spacing_is_found_with_its_own_width():
    """The posterior of a flat belief is the likelihood itself, here a Gaussian."""
    target = peak(3.0, -4.0, 3.1, 0.02, 0.01)
    poses, weights = annealed(1, target, 2)
    mean = weighted_mean(poses, weights)
    assert (mean.x_m, mean.y_m) == pytest.approx((3.0, -4.0), abs=0.004)
    assert math.cos(mean.theta_rad - 3.1) == pytest.approx(1.0, abs=1e-6)
    sigmas = np.sqrt(np.diag(weighted_covariance(poses, weights, mean)))
    np.testing.assert_allclose(sigmas, [0.02, 0.02, 0.01], rtol=0.15)


def test_a_fifth_of_the_particles_goes_on_and_finds_the_same_peak():
    poses, weights = annealed(1, peak(3.0, -4.0, 3.1, 0.2, 0.1), 2, N // 5)
    assert len(poses) == N // 5
    mean = weighted_mean(poses, weights)
    assert (mean.x_m, mean.y_m) == pytest.approx((3.0, -4.0), abs=0.04)
    sigmas = np.sqrt(np.diag(weighted_covariance(poses, weights, mean)))
    np.testing.assert_allclose(sigmas, [0.2, 0.2, 0.1], rtol=0.15)


def test_two_peaks_keep_the_shares_of_their_volumes():
    """exp(log-likelihood) integrates to sigma_m^2 sigma_rad: 8 to 1, less a height of 2 to 1."""
    wide, narrow = peak(5.0, 5.0, 0.0, 0.4, 0.2), peak(-5.0, -5.0, 1.0, 0.2, 0.1)

    def both(poses: np.ndarray) -> np.ndarray:
        return np.logaddexp(wide(poses), narrow(poses) + math.log(2.0))

    shares = []
    for seed in range(5):
        poses, weights = annealed(seed, both, seed)
        shares.append(weights[poses[:, 0] > 0].sum())
    assert np.mean(shares) == pytest.approx(0.8, abs=0.08)


def test_what_is_impossible_everywhere_says_nothing():
    def impossible(poses: np.ndarray) -> np.ndarray:
        return np.full(len(poses), -math.inf)

    assert annealed(0, impossible, 0) is None


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_likelihood_that_is_no_number_is_refused(bad):
    def broken(poses: np.ndarray) -> np.ndarray:
        return np.where(poses[:, 0] > 0.0, bad, 0.0)

    with pytest.raises(ValueError, match="log-likelihoods must be < inf"):
        annealed(0, broken, 0)
