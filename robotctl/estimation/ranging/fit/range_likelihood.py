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
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.ranging.range_mixture import BeamMixture

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


class RangeLikelihood:
    """Readings, ready to be weighed by any mixture.

    Parameters
    ----------
    expected_m
        Of the readings with a range, (h,) [m]; inf if nothing is in range.
    measured_m
        Their ranges, (h,) [m].
    missing
        (e,): whether an echo was expected, of each reading without a range.
    max_range_m
        The sensor's greatest range [m].
    """

    def __init__(
        self,
        expected_m: Array,
        measured_m: Array,
        missing: NDArray[np.bool_],
        max_range_m: float,
    ) -> None:
        self.expected_m = expected_m
        self.measured_m = measured_m
        self.missing = missing
        self.max_range_m = max_range_m
        anything = np.isfinite(expected_m)
        self._m = np.where(anything, expected_m, 0.0)
        self._off = measured_m - self._m
        self._anything = anything.astype(np.float64)
        ends = np.where(anything, expected_m, max_range_m)
        self._before = (measured_m < ends).astype(np.float64)
        self._cut = np.clip(ends, 1e-9, max_range_m)

    def logs(self, parameters: Array) -> tuple[Array, Array]:
        """Return log p of each reading, those with a range first, (m,), and its score (m, 7)."""
        p, parts = self._heard(parameters)
        garbage, none = parameters[0], parameters[2]
        silent = np.where(self.missing, none, 1.0 - garbage)
        by_silent = np.zeros((len(silent), 7))
        by_silent[:, 0] = np.where(self.missing, 0.0, -1.0) / silent
        by_silent[:, 2] = np.where(self.missing, 1.0, 0.0) / silent
        by_heard = np.stack(parts, axis=1) / p[:, np.newaxis]
        return np.log(np.concatenate([p, silent])), np.concatenate([by_heard, by_silent])

    def total(self, parameters: Array) -> tuple[float, Array, Array]:
        """Return the sum of all logs, its score (7,), and the outer products of the scores (7, 7).

        The latter are the information about the parameters, near the best ones.
        """
        p, parts = self._heard(parameters)
        garbage, none = float(parameters[0]), float(parameters[2])
        each = np.array(parts) / p
        score, outer = each.sum(axis=1), each @ each.T
        due = int(np.count_nonzero(self.missing))
        not_due = len(self.missing) - due
        score[0] -= not_due / (1.0 - garbage)
        score[2] += due / none
        outer[0, 0] += not_due / (1.0 - garbage) ** 2
        outer[2, 2] += due / none**2
        logs = float(np.log(p).sum()) + due * math.log(none) + not_due * math.log1p(-garbage)
        return logs, score, outer

    def _heard(self, parameters: Array) -> tuple[Array, tuple[Array, ...]]:
        """Return densities (h,) of the readings with a range, and their seven derivatives."""
        garbage, share, none, a, b, offset, rate = parameters.tolist()
        weight = 1.0 - garbage - none
        sigma = a + b * self._m
        off = (self._off - offset) / sigma
        hit = np.exp(-0.5 * off * off) * self._anything / (math.sqrt(math.tau) * sigma)
        short, by_rate = _exponential(self.measured_m, self._cut, rate)
        short *= self._before
        uniform = 1.0 / self.max_range_m
        other = share * short + (1.0 - share) * uniform
        p = np.maximum(weight * hit + garbage * other, 1e-300)
        by_offset = weight * hit * off / sigma
        by_sigma = by_offset * off - weight * hit / sigma
        return p, (
            other - hit,
            garbage * (short - uniform),
            -hit,
            by_sigma,
            by_sigma * self._m,
            by_offset,
            garbage * share * (by_rate * self._before),
        )


def _exponential(z: Array, cut: Array, rate: float) -> tuple[Array, Array]:
    """Return the density of an exponential cut off, (h,), and its derivative by the rate.

    d/d rate of the log is 1/rate - z - cut / (e^(rate cut) - 1), which is cut / 2 - z at 0.
    """
    x = rate * cut
    density = rate * np.exp(-rate * z) / -np.expm1(-x)
    near_0 = cut * (0.5 - x / 12.0)
    log_slope = np.where(x < _SERIES, near_0, 1.0 / rate - cut * np.exp(-x) / -np.expm1(-x)) - z
    return density, density * log_slope
