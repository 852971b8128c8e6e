"""The mixture of readings: against the book's formulas, and learned from what it draws."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robotctl.estimation.ranging.range_mixture import BeamMixture, densities, learned

MIXTURE = BeamMixture(0.6, 0.2, 0.05, 0.15, sigma_m=0.08, offset_m=0.03, short_per_m=0.7)
FAR_M = 10.0


def book(mixture: BeamMixture, z_star: float, z: float) -> float:
    """Likelihood of one range: Probabilistic Robotics, equations 6.4 to 6.12, without an eta."""
    if z >= FAR_M:
        return mixture.none + (mixture.hit if z_star == math.inf else 0.0)
    off = (z - z_star - mixture.offset_m) / mixture.sigma_m
    p = mixture.hit * math.exp(-0.5 * off * off) / (mixture.sigma_m * math.sqrt(2 * math.pi))
    if z < z_star:
        rate = mixture.short_per_m
        eta = 1.0 / (1.0 - math.exp(-rate * min(z_star, FAR_M)))
        p += mixture.short * eta * rate * math.exp(-rate * z)
    return p + mixture.random / FAR_M


def test_the_density_is_that_of_the_book():
    rng = np.random.default_rng(1)
    z_star = rng.uniform(0.0, 9.9, (50, 30))
    z_star[:, :3] = np.inf
    z_star[:, 4] = 0.0
    z = rng.uniform(0.0, 9.9, (50, 1))
    z[:10, 0] = z_star[:10, 7] + 0.05
    wanted = np.array(
        [
            [book(MIXTURE, m, at) for m in row]
            for row, at in zip(z_star, z[:, 0].tolist(), strict=True)
        ]
    )
    found = sum(densities(MIXTURE, z_star, z, FAR_M)) + MIXTURE.random / FAR_M
    np.testing.assert_allclose(found, wanted, rtol=1e-6)


@pytest.mark.parametrize("z_star", [1.0, 4.2, 9.0, math.inf])
def test_all_readings_together_have_probability_1(z_star):
    z = np.linspace(0.0, FAR_M, 100_001)[:-1]
    density = sum(densities(MIXTURE, np.full(100_000, z_star), z, FAR_M)) + MIXTURE.random / FAR_M
    none = book(MIXTURE, z_star, FAR_M)
    assert density.mean() * FAR_M + none == pytest.approx(1.0, abs=1e-3)


def drawn(mixture: BeamMixture, z_star: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Draw a range for each expected one, part by part."""
    n = len(z_star)
    part = rng.choice(4, n, p=[mixture.hit, mixture.short, mixture.none, mixture.random])
    hit = z_star + mixture.offset_m + mixture.sigma_m * rng.standard_normal(n)
    cut = -np.expm1(-mixture.short_per_m * np.minimum(z_star, FAR_M))
    short = -np.log1p(-rng.random(n) * cut) / mixture.short_per_m
    z = np.choose(part, [hit, short, np.full(n, np.inf), FAR_M * rng.random(n)])
    return np.where(z < FAR_M, np.maximum(z, 0.0), np.inf)


def test_learning_finds_the_mixture_that_drew_the_ranges():
    rng = np.random.default_rng(2)
    z_star = rng.uniform(0.5, 8.0, 40_000)
    z_star[:2000] = np.inf
    z_star[2000:2010] = 0.0
    z = drawn(MIXTURE, z_star, rng)
    z[5000:5100] = np.nan
    found = learned(BeamMixture(), z_star, z, FAR_M, iterations=200)
    for key in ("hit", "short", "none", "random"):
        assert getattr(found, key) == pytest.approx(getattr(MIXTURE, key), abs=0.02)
    assert found.sigma_m == pytest.approx(MIXTURE.sigma_m, rel=0.05)
    assert found.offset_m == pytest.approx(MIXTURE.offset_m, abs=0.004)
    assert found.short_per_m == pytest.approx(MIXTURE.short_per_m, rel=0.15)


def test_no_step_of_learning_makes_the_ranges_less_likely():
    rng = np.random.default_rng(3)
    z_star = rng.uniform(0.5, 8.0, 5000)
    z = drawn(MIXTURE, z_star, rng)
    mixture = BeamMixture(sigma_m=0.5, short_per_m=3.0)
    before = -math.inf
    for _ in range(15):
        total = sum(math.log(book(mixture, a, b)) for a, b in zip(z_star, z, strict=True))
        assert total >= before - 1e-6
        before = total
        mixture = learned(mixture, z_star, z, FAR_M, iterations=1)


def test_no_part_is_learned_to_be_impossible():
    exact = np.linspace(1.0, 5.0, 100)
    found = learned(BeamMixture(), exact, exact, FAR_M)
    assert min(found.short, found.none, found.random) > 5e-4
    assert found.sigma_m >= 1e-3


def test_learning_from_nothing_is_refused():
    with pytest.raises(ValueError, match="no pair"):
        learned(BeamMixture(), np.array([1.0]), np.array([np.nan]), FAR_M)


@pytest.mark.parametrize(
    ("key", "value"), [("hit", 0.9), ("sigma_m", 0.0), ("short_per_m", math.nan)]
)
def test_a_number_of_the_mixture_out_of_its_range_is_refused(key, value):
    with pytest.raises(ValueError, match=key):
        BeamMixture(**{key: value})
