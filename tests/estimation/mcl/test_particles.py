"""Weighted samples: textbook loops as oracles, and laws of resampling."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.estimation.mcl.particles import (
    effective_size,
    normalised,
    posterior,
    resample_systematic,
    weighted_covariance,
    weighted_mean,
)
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2

seeds = st.integers(0, 2**32 - 1)


def random_weights(rng: np.random.Generator, n: int) -> np.ndarray:
    weights = rng.exponential(size=n) * (rng.random(n) < 0.7)
    weights[rng.integers(n)] += 0.1
    return weights / weights.sum()


def textbook_comb(weights: np.ndarray, count: int, shift: float) -> list[int]:
    """Probabilistic Robotics, table 4.4, with r = shift / count."""
    result = []
    c, i = weights[0], 0
    for m in range(count):
        u = (shift + m) / count
        while u > c and i + 1 < len(weights):
            i += 1
            c += weights[i]
        result.append(i)
    return result


class Fixed:
    """A generator of one number."""

    def __init__(self, value: float) -> None:
        self._value = value

    def random(self) -> float:
        return self._value


@given(seeds, st.integers(1, 60), st.integers(1, 200))
def test_resampling_draws_what_the_textbook_loop_draws(seed, n, count):
    rng = np.random.default_rng(seed)
    weights, shift = random_weights(rng, n), rng.random()
    drawn = resample_systematic(weights, count, Fixed(shift))
    assert drawn.tolist() == textbook_comb(weights, count, shift)


@given(seeds, st.integers(1, 60), st.integers(1, 200))
def test_each_particle_is_taken_its_share_of_times_rounded_down_or_up(seed, n, count):
    rng = np.random.default_rng(seed)
    weights = random_weights(rng, n)
    times = np.bincount(resample_systematic(weights, count, rng), minlength=n)
    assert np.all(np.abs(times - count * weights) < 1.0 + 1e-9)


def test_in_the_mean_each_particle_is_taken_its_share_of_times():
    rng = np.random.default_rng(4)
    weights, rounds = random_weights(rng, 12), 20_000
    times = np.zeros(12)
    for _ in range(rounds):
        times += np.bincount(resample_systematic(weights, 5, rng), minlength=12)
    # A count is Bernoulli about its share: at most 0.5 / sqrt(rounds) off by one sigma.
    np.testing.assert_allclose(times / rounds, 5 * weights, atol=4.0 * 0.5 / math.sqrt(rounds))


@pytest.mark.parametrize("shift", [0.0, 0.5, np.nextafter(1.0, 0.0)])
def test_a_particle_without_weight_is_never_taken(shift):
    weights = np.array([0.0, 0.3, 0.0, 0.7, 0.0])
    assert set(resample_systematic(weights, 10, Fixed(shift)).tolist()) == {1, 3}


def test_the_effective_size_is_that_of_equal_weights_and_of_one():
    assert effective_size(np.full(40, 1 / 40)) == pytest.approx(40.0)
    assert effective_size(np.array([0.0, 1.0, 0.0])) == pytest.approx(1.0)


@given(st.floats(-1e5, 1e5))
def test_normalisation_does_not_depend_on_the_scale_of_the_likelihood(offset):
    logs = np.array([-3.0, 0.5, -700.0, -math.inf])
    weights, log_sum = normalised(logs + offset)
    expected = np.exp(logs)
    np.testing.assert_allclose(weights, expected / expected.sum(), rtol=1e-9, atol=1e-300)
    assert log_sum - offset == pytest.approx(math.log(expected.sum()), abs=1e-9)


@pytest.mark.parametrize("bad", [[-math.inf, -math.inf], [0.0, math.nan], [0.0, math.inf]])
def test_weights_that_cannot_be_normalised_are_refused(bad):
    with pytest.raises(ValueError, match="must be finite"):
        normalised(np.array(bad))


def test_the_posterior_is_bayes_rule():
    weights, likelihoods = np.array([0.2, 0.0, 0.8]), np.array([0.5, 0.9, 0.1])
    after, log_evidence = posterior(weights, np.log(likelihoods))
    np.testing.assert_allclose(after, [0.1 / 0.18, 0.0, 0.08 / 0.18])
    assert log_evidence == pytest.approx(math.log(0.18))


def test_an_impossible_measurement_leaves_the_weights():
    weights = np.array([0.25, 0.75])
    after, log_evidence = posterior(weights, np.full(2, -math.inf))
    np.testing.assert_array_equal(after, weights)
    assert log_evidence == -math.inf


@given(seeds, st.floats(-math.pi, math.pi))
def test_mean_and_covariance_turn_with_the_particles_across_the_cut_of_the_circle(seed, turn):
    rng = np.random.default_rng(seed)
    poses = rng.normal(size=(50, 3)) * (1.0, 2.0, 0.3)
    weights = random_weights(rng, 50)
    mean = weighted_mean(poses, weights)
    turned = poses + np.array([0.0, 0.0, turn])
    turned[:, 2] = [wrap_angle(theta) for theta in turned[:, 2]]
    its_mean = weighted_mean(turned, weights)
    assert wrap_angle(its_mean.theta_rad - mean.theta_rad - turn) == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(
        weighted_covariance(turned, weights, its_mean),
        weighted_covariance(poses, weights, mean),
        atol=1e-9,
    )


def test_mean_and_covariance_are_those_of_numpy():
    rng = np.random.default_rng(3)
    poses, weights = rng.normal(size=(200, 3)) * 0.2, random_weights(rng, 200)
    mean = weighted_mean(poses, weights)
    centre = np.average(poses, axis=0, weights=weights)
    assert (mean.x_m, mean.y_m) == pytest.approx(tuple(centre[:2]))
    about = SE2(mean.x_m, mean.y_m, float(centre[2]))
    np.testing.assert_allclose(
        weighted_covariance(poses, weights, about),
        np.cov(poses.T, aweights=weights, ddof=0),
        atol=1e-12,
    )
