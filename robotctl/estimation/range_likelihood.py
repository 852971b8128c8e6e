"""The log-likelihood of range readings as a function of the mixture's parameters, with its score.

The mixture is that of `range_mixture.py`. Its parameters are a vector of seven numbers here, of
which any may be held fixed:

    garbage      probability of a reading that has nothing to do with the map, short or random
    short_share  share of the short ones in these
    none         probability that an echo is missing
    sigma_m, sigma_per_m, offset_m, short_per_m

All intervals of `range_fit.py` rest on this one function; its derivatives are exact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.range_mixture import BeamMixture

Array: TypeAlias = NDArray[np.float64]

NAMES: Final = (
    "garbage",
    "short_share",
    "none",
    "sigma_m",
    "sigma_per_m",
    "offset_m",
    "short_per_m",
)
LOW: Final = np.array([1e-9, 1e-6, 1e-9, 1e-5, 0.0, -math.inf, 1e-4])
HIGH: Final = np.array([0.7, 1.0 - 1e-6, 0.7, math.inf, 1.0, math.inf, 1e3])
"""Bounds; a parameter that ends at one lies on it."""
_SERIES: Final = 1e-3


def parameters_of(mixture: BeamMixture) -> Array:
    """Return the parameters of a mixture, (7,)."""
    garbage = mixture.short + mixture.random
    return np.array(
        [
            garbage,
            mixture.short / garbage,
            mixture.none,
            mixture.sigma_m,
            mixture.sigma_per_m,
            mixture.offset_m,
            mixture.short_per_m,
        ]
    )


def mixture_of(parameters: Array) -> BeamMixture:
    """Return the mixture of parameters (7,)."""
    garbage, share, none, sigma_m, sigma_per_m, offset_m, rate = parameters.tolist()
    return BeamMixture(
        1.0 - garbage - none,
        garbage * share,
        none,
        garbage * (1.0 - share),
        sigma_m,
        offset_m,
        rate,
        sigma_per_m,
    )


@dataclass(frozen=True, slots=True, eq=False)
class RangeLikelihood:
    """Readings, ready to be weighed by any mixture.

    Parameters
    ----------
    expected_m
        Of the readings with a range, (h,) [m]; inf where nothing is in range.
    measured_m
        Their ranges, (h,) [m].
    missing
        (e,): whether an echo was expected, of each reading without a range.
    max_range_m
        The sensor's greatest range [m].
    """

    expected_m: Array
    measured_m: Array
    missing: NDArray[np.bool_]
    max_range_m: float

    def logs(self, parameters: Array) -> tuple[Array, Array]:
        """Return log p of each reading, those with a range first, (m,), and its score (m, 7)."""
        heard, by_heard = self._heard(parameters)
        garbage, none = parameters[0], parameters[2]
        p = np.where(self.missing, none, 1.0 - garbage)
        by_missing = np.zeros((len(p), 7))
        by_missing[:, 0] = np.where(self.missing, 0.0, -1.0) / p
        by_missing[:, 2] = np.where(self.missing, 1.0, 0.0) / p
        return np.concatenate([heard, np.log(p)]), np.concatenate([by_heard, by_missing])

    def _heard(self, parameters: Array) -> tuple[Array, Array]:
        """Return logs and score of the readings with a range."""
        garbage, share, none, a, b, offset, rate = parameters.tolist()
        anything = np.isfinite(self.expected_m)
        m = np.where(anything, self.expected_m, 0.0)
        sigma = a + b * m
        off = self.measured_m - m - offset
        hit = np.exp(-0.5 * (off / sigma) ** 2) / (math.sqrt(math.tau) * sigma)
        hit[~anything] = 0.0
        before = self.measured_m < np.where(anything, m, self.max_range_m)
        cut = np.where(anything, np.minimum(m, self.max_range_m), self.max_range_m)
        short, by_rate = _exponential(self.measured_m, np.maximum(cut, 1e-9), rate)
        short, by_rate = short * before, by_rate * before
        uniform = 1.0 / self.max_range_m
        p = (1.0 - garbage - none) * hit + garbage * (share * short + (1.0 - share) * uniform)
        score = np.empty((len(p), 7))
        score[:, 0] = share * short + (1.0 - share) * uniform - hit
        score[:, 1] = garbage * (short - uniform)
        score[:, 2] = -hit
        by_sigma = (1.0 - garbage - none) * hit * ((off / sigma) ** 2 - 1.0) / sigma
        score[:, 3] = by_sigma
        score[:, 4] = by_sigma * m
        score[:, 5] = (1.0 - garbage - none) * hit * off / sigma**2
        score[:, 6] = garbage * share * by_rate
        p = np.maximum(p, 1e-300)
        return np.log(p), score / p[:, np.newaxis]


def _exponential(z: Array, cut: Array, rate: float) -> tuple[Array, Array]:
    """Return the density of an exponential cut off, (h,), and its derivative by the rate.

    d/d rate of the log is 1/rate - z - cut / (e^(rate cut) - 1), which is cut / 2 - z at 0.
    """
    x = rate * cut
    density = rate * np.exp(-rate * z) / -np.expm1(-x)
    near_0 = cut * (0.5 - x / 12.0)
    log_slope = np.where(x < _SERIES, near_0, 1.0 / rate - cut * np.exp(-x) / -np.expm1(-x)) - z
    return density, density * log_slope
