"""The mixture of readings that a range sensor makes, and how it is learned.

Four things make a range z where the map has its first obstacle at z* (Thrun, Burgard, Fox:
Probabilistic Robotics, section 6.3):

- hit: the obstacle, with Gaussian noise about z* + offset, of the standard deviation
  sigma_m + sigma_per_m z*;
- short: something in front that the map has not, people most of all: exponential, cut off at z*;
- none: no echo, the sensor's greatest range;
- random: anything, uniform.

Where the map has nothing within the greatest range, a hit is a reading without an echo. Each part
is a density or a probability of sum 1 (the Gaussian's tails below 0 and beyond the greatest range
are neglected), so the mixture is a likelihood.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

_Real = TypeVar("_Real", np.float32, np.float64)

LEAST_WEIGHT: Final = 1e-3
LEAST_SIGMA_M: Final = 1e-3
"""No part is ever learned to be impossible, nor an obstacle to be exact."""
_SCORING: Final = 3
"""Steps of Fisher's scoring for a standard deviation that grows, in each step of the learning."""


@dataclass(frozen=True, slots=True)
class BeamMixture:
    """Weights and shapes of the four parts.

    Parameters
    ----------
    hit, short, none, random
        Weights, > 0, of sum 1.
    sigma_m
        Standard deviation of a hit, of sensor and map together [m], > 0.
    offset_m
        Mean error of a hit [m].
    short_per_m
        Rate of the exponential [1/m], > 0.
    sigma_per_m
        Growth of the standard deviation per metre of expected range, >= 0.

    Raises
    ------
    ValueError
        If a number is out of its range.
    """

    hit: float = 0.85
    short: float = 0.03
    none: float = 0.02
    random: float = 0.1
    sigma_m: float = 0.1
    offset_m: float = 0.05
    short_per_m: float = 0.1
    sigma_per_m: float = 0.0

    def __post_init__(self) -> None:
        for key in ("hit", "short", "none", "random", "sigma_m", "short_per_m"):
            value = getattr(self, key)
            if not 0.0 < value < math.inf:
                raise ValueError(f"{key} must be finite and > 0, found {value}")
        if not 0.0 <= self.sigma_per_m < math.inf:
            raise ValueError(f"sigma_per_m must be finite and >= 0, found {self.sigma_per_m}")
        if not math.isfinite(self.offset_m):
            raise ValueError(f"offset_m must be finite, found {self.offset_m}")
        total = self.hit + self.short + self.none + self.random
        if abs(total - 1.0) > 1e-6:
            raise ValueError(f"hit, short, none and random must sum to 1, found {total}")

    def sigma_at(self, expected_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the standard deviation of hits at expected ranges, (m,) [m]."""
        found: NDArray[np.float64] = self.sigma_m + self.sigma_per_m * expected_m
        return found

    def robust_k(self, range_m: float, max_range_m: float) -> float:
        """Return K of the robust likelihood exp(-(z - m)^2 / 2 sigma^2) + K.

        It is the density of readings that have nothing to do with the map, short ones and random
        ones, over the greatest density of a hit at `range_m` [m]. They are taken as spread up to
        twice that range: a sensor may reach far beyond the room in which it is used.
        """
        sigma_m = self.sigma_m + self.sigma_per_m * range_m
        garbage = (self.short + self.random) / min(2.0 * range_m, max_range_m)
        return garbage * math.sqrt(math.tau) * sigma_m / self.hit


def densities(
    mixture: BeamMixture, z_star: NDArray[_Real], z: NDArray[_Real], max_range_m: float
) -> tuple[NDArray[_Real], NDArray[_Real]]:
    """Return the weighted densities of hit and of short at ranges z < max, in z's precision.

    z* and z are of shapes that broadcast together; z* is inf if nothing is in range.
    """
    off = z_star - (z - mixture.offset_m)
    # At z* = inf any finite sigma does: a hit has no density there.
    sigma: float | NDArray[_Real] = mixture.sigma_m
    if mixture.sigma_per_m > 0.0:
        sigma = np.minimum(z_star, max_range_m)
        sigma *= mixture.sigma_per_m
        sigma += mixture.sigma_m
    off *= math.sqrt(0.5) / sigma
    hit = np.exp(np.negative(np.square(off, out=off), out=off), out=off)
    hit *= mixture.hit / math.sqrt(math.tau) / sigma
    rate = mixture.short_per_m
    uncut = mixture.short * rate * np.exp(-rate * z)
    within = 1.0 - np.exp(-rate * np.minimum(z_star, max_range_m))  # numpy's expm1 is slow
    short = uncut / np.maximum(within, 1e-30)
    short *= z < z_star
    return hit, short


def learned(
    mixture: BeamMixture,
    expected_m: NDArray[np.float64],
    measured_m: NDArray[np.float64],
    max_range_m: float,
    iterations: int = 50,
    *,
    sigma_grows: bool = False,
) -> BeamMixture:
    """Return the mixture that fits pairs of expected and measured ranges best, by EM.

    Probabilistic Robotics, table 6.2, with the offset of a hit, and with the exponential's cut: at
    z* its mean is 1/rate - z* / (e^(rate z*) - 1).

    Parameters
    ----------
    mixture
        Values from which the search starts.
    expected_m, measured_m
        z* and z of many beams, (m,) [m]; inf if the map has nothing in range and without an
        echo. Pairs of nan are left out.
    max_range_m
        The sensor's greatest range [m].
    iterations
        Number of steps of expectation and maximisation.
    sigma_grows
        Whether sigma_per_m is learned too; else it stays.

    Raises
    ------
    ValueError
        If there is no pair.
    """
    valid = ~np.isnan(measured_m)
    z_star, z = expected_m[valid], measured_m[valid]
    if len(z) == 0:
        raise ValueError("no pair of expected and measured ranges to learn from")
    seen = z < max_range_m
    none = int(np.count_nonzero(~seen))
    none_expected = int(np.count_nonzero(np.isinf(z_star[~seen])))
    for _ in range(iterations):
        mixture, r_hit = _em_step(mixture, z_star[seen], z[seen], max_range_m, none, none_expected)
        if r_hit.sum() > 0.0:
            mixture = _with_noise(mixture, z_star[seen], z[seen], r_hit, grows=sigma_grows)
    return mixture


def _em_step(
    mixture: BeamMixture,
    z_star: NDArray[np.float64],
    z: NDArray[np.float64],
    max_range_m: float,
    none: int,
    none_expected: int,
) -> tuple[BeamMixture, NDArray[np.float64]]:
    """Return the mixture with new weights and rate, and how probably each reading is a hit.

    From pairs with a reading and counts of those without.
    """
    hit, short = densities(mixture, z_star, z, max_range_m)
    p = hit + short + mixture.random / max_range_m
    r_hit, r_short = hit / p, short / p
    hit_none = none_expected * mixture.hit / (mixture.hit + mixture.none)
    weights = np.array(
        [
            r_hit.sum() + hit_none,
            r_short.sum(),
            none - hit_none,
            len(z) - r_hit.sum() - r_short.sum(),
        ]
    )
    weights = np.maximum(weights / weights.sum(), LEAST_WEIGHT)
    w_hit, w_short, w_none, w_random = (weights / weights.sum()).tolist()
    rate = mixture.short_per_m
    before = r_short > 0.0
    if before.any():
        cut = np.minimum(z_star[before], max_range_m)
        beyond = cut * np.exp(-rate * cut) / -np.expm1(-rate * cut)
        rate = 1.0 / float(np.average(z[before] + beyond, weights=r_short[before]))
    learned_weights = replace(
        mixture, hit=w_hit, short=w_short, none=w_none, random=w_random, short_per_m=rate
    )
    return learned_weights, r_hit


def _with_noise(
    mixture: BeamMixture,
    z_star: NDArray[np.float64],
    z: NDArray[np.float64],
    r_hit: NDArray[np.float64],
    *,
    grows: bool,
) -> BeamMixture:
    """Return the mixture with the offset and the noise of its hits, each weighed by `r_hit`."""
    m = np.where(np.isfinite(z_star), z_star, 0.0)
    off = np.where(np.isfinite(z_star), z - z_star, 0.0)
    sigma = mixture.sigma_at(m)
    offset_m = float(np.average(off, weights=r_hit / sigma**2))
    off -= offset_m
    a, b = mixture.sigma_m, mixture.sigma_per_m
    if not grows and b == 0.0:
        a = math.sqrt(float(np.average(off**2, weights=r_hit)))
        return replace(mixture, sigma_m=max(a, LEAST_SIGMA_M), offset_m=offset_m)
    columns = np.stack([np.ones_like(m), m], axis=1)[:, : 2 if grows else 1]
    for _ in range(_SCORING):
        sigma = a + b * m
        score = columns.T @ (r_hit * (off**2 - sigma**2) / sigma**3)
        information = 2.0 * (columns * (r_hit / sigma**2)[:, np.newaxis]).T @ columns
        step = np.linalg.lstsq(information, score, rcond=1e-12)[0]
        a = max(a + float(step[0]), 0.3 * a, LEAST_SIGMA_M)
        b = max(b + float(step[1]), 0.0) if grows else b
    return replace(mixture, sigma_m=a, sigma_per_m=b, offset_m=offset_m)
