"""Parameters of a range sensor from measured and expected ranges: mixture and intervals.

Expectation maximisation (`range_mixture.learned`) finds the mixture, Newton-like steps take it to
the top of the likelihood, and profiles of the likelihood give intervals (`range_profile.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.ranging.fit.range_likelihood import (
    LOW,
    NAMES,
    Array,
    RangeLikelihood,
    mixture_of,
    parameters_of,
)
from robotctl.estimation.ranging.fit.range_profile import RangeProfile
from robotctl.estimation.ranging.range_mixture import BeamMixture, learned

_EM_STEPS: Final = 30
_GROWTH: Final = NAMES.index("sigma_per_m")
_LEAST_HITS: Final = 50
_SPREAD: Final = 1.5
"""Ratio of the far tenth of hits to the near tenth from which the growth of sigma is determined."""
_RATE_FOLD: Final = 100.0
"""A rate is known if its interval spans less than this factor."""


@dataclass(frozen=True, slots=True)
class Fitted:
    """A value with its 95 % interval.

    Parameters
    ----------
    value, low, high
        Best value and ends.
    why_not
        Why the data do not determine the value; empty if they do.
    """

    value: float
    low: float
    high: float
    why_not: str = ""

    def in_degrees(self) -> Fitted:
        """Return an angle in degrees."""
        return Fitted(
            math.degrees(self.value),
            math.degrees(self.low),
            math.degrees(self.high),
            self.why_not,
        )


@dataclass(frozen=True, slots=True, eq=False)
class RangeFit:
    """Estimated parameters of a sensor.

    Parameters
    ----------
    mixture
        The best one.
    values
        By name: hit, short, none, random, garbage (short and random), sigma_m, sigma_per_m,
        offset_m, short_per_m and robust_k.
    typical_m
        Median of the expected ranges, for which robust_k holds [m].
    stretches
        Stretches of the log, independent of each other.
    """

    mixture: BeamMixture
    values: dict[str, Fitted]
    typical_m: float
    stretches: int


def fit_ranges(
    expected_m: Array,
    measured_m: Array,
    max_range_m: float,
    stretches: NDArray[np.intp] | None = None,
) -> RangeFit:
    """Fit the mixture to readings, with 95 % intervals.

    Parameters
    ----------
    expected_m
        How far each reading should go, (m,) [m]; inf: nothing in range.
    measured_m
        Measured ranges, (m,) [m]; inf or at least `max_range_m`: no echo; nan is left out.
    max_range_m
        The sensor's greatest range [m].
    stretches
        Number of the stretch of the log that each reading belongs to, (m,); those of different
        stretches err independently. None: all readings do.

    Returns
    -------
    RangeFit
        Best values, intervals, and why a value is undetermined.

    Raises
    ------
    ValueError
        If shapes differ, or fewer than 50 readings are hits.
    """
    profile, likelihood = _climbed(expected_m, measured_m, max_range_m, stretches)
    values = {name: _fitted(profile, i) for i, name in enumerate(NAMES)}
    values |= _parts(values)
    mixture = mixture_of(profile.best)
    seen = likelihood.expected_m[np.isfinite(likelihood.expected_m)]
    typical_m = float(np.median(seen))
    values["robust_k"] = _robust_k(mixture, values, typical_m, max_range_m)
    del values["short_share"]
    readings = len(likelihood.measured_m) + len(likelihood.missing)
    _say(values, readings, seen)
    return RangeFit(mixture, values, typical_m, profile.stretches)


def _fitted(profile: RangeProfile, i: int) -> Fitted:
    """Return a parameter with its interval; what lies on its lower bound, if any, is 0."""
    low, high = profile.interval(i)
    bound = float(LOW[i])
    value, low, high = (
        0.0 if math.isfinite(bound) and each <= bound else each
        for each in (float(profile.best[i]), low, high)
    )
    return Fitted(value, low, high)


def best_mixture(expected_m: Array, measured_m: Array, max_range_m: float) -> BeamMixture:
    """Return the mixture that fits readings best, as `fit_ranges`, without the intervals."""
    return mixture_of(_climbed(expected_m, measured_m, max_range_m, None)[0].best)


def _climbed(
    expected_m: Array,
    measured_m: Array,
    max_range_m: float,
    stretches: NDArray[np.intp] | None,
) -> tuple[RangeProfile, RangeLikelihood]:
    """Check readings and climb to the top of their likelihood."""
    if expected_m.shape != measured_m.shape or expected_m.ndim != 1:
        raise ValueError(
            f"expected_m {expected_m.shape} and measured_m {measured_m.shape} must both be (m,)"
        )
    valid = ~np.isnan(measured_m)
    m, z = expected_m[valid], measured_m[valid]
    m = np.where(m < max_range_m, m, np.inf)
    heard = z < max_range_m
    both = int(np.count_nonzero(np.isfinite(m) & heard))
    if both < _LEAST_HITS:
        raise ValueError(
            f"{both} readings with a range where one was expected, at least {_LEAST_HITS} needed"
        )
    groups = np.arange(len(z)) if stretches is None else stretches[valid]
    order = np.concatenate([np.flatnonzero(heard), np.flatnonzero(~heard)])
    _, groups = np.unique(groups[order], return_inverse=True)
    free = np.ones(len(NAMES), np.bool_)
    free[_GROWTH] = _tells_growth(m[heard])
    start = learned(_start(m[heard], z[heard]), m, z, max_range_m, _EM_STEPS)
    if free[_GROWTH]:
        start = learned(start, m, z, max_range_m, _EM_STEPS, sigma_grows=True)
    likelihood = RangeLikelihood(m[heard], z[heard], np.isfinite(m[~heard]), max_range_m)
    return RangeProfile(likelihood, groups, parameters_of(start), free), likelihood


def _tells_growth(expected_m: Array) -> bool:
    """Whether the spread of ranges suffices to determine the growth of noise."""
    near, far = np.quantile(expected_m[np.isfinite(expected_m)], [0.1, 0.9]).tolist()
    return bool(far >= _SPREAD * near)


def _parts(values: dict[str, Fitted]) -> dict[str, Fitted]:
    """Return hit, short and random, which follow from the parameters."""
    garbage, share, none = values["garbage"], values["short_share"], values["none"]
    hit = 1.0 - garbage.value - none.value
    low = hit - math.hypot(garbage.high - garbage.value, none.high - none.value)
    high = hit + math.hypot(garbage.value - garbage.low, none.value - none.low)
    short = _product(garbage, share)
    other = Fitted(1.0 - share.value, 1.0 - share.high, 1.0 - share.low)
    return {
        "hit": Fitted(hit, low, min(high, 1.0)),
        "short": short,
        "random": _product(garbage, other),
    }


def _robust_k(
    mixture: BeamMixture, values: dict[str, Fitted], typical_m: float, max_range_m: float
) -> Fitted:
    """Return K at the typical range: as uncertain as garbage, sigma and hit together."""
    of_garbage = mixture.robust_k(typical_m, max_range_m) / (mixture.short + mixture.random)
    hit, sigma = values["hit"], values["sigma_m"]
    below = math.hypot(_log_ratio(hit.high, hit.value), _log_ratio(sigma.value, sigma.low))
    above = math.hypot(_log_ratio(hit.value, hit.low), _log_ratio(sigma.high, sigma.value))
    factor = Fitted(of_garbage, of_garbage * math.exp(-below), of_garbage * math.exp(above))
    return _product(values["garbage"], factor)


def _say(values: dict[str, Fitted], readings: int, seen_m: Array) -> None:
    """Mark values that the data do not determine."""
    why: dict[str, str] = {}
    if not _tells_growth(seen_m):
        why["sigma_per_m"] = (
            f"all echoes come from about {np.median(seen_m):.2g} m, so the growth of noise with "
            "range is undetermined; sigma_m holds there"
        )
    rate = values["short_per_m"]
    if values["short"].low < 1e-6 or rate.high > _RATE_FOLD * max(rate.low, 1e-2):
        why["short_per_m"] = (
            f"about {values['short'].value * readings:.0f} readings are short, too few to "
            "determine their distribution"
        )
    for name, reason in why.items():
        at = values[name]
        values[name] = Fitted(at.value, at.low, at.high, reason)


def _start(m: Array, z: Array) -> BeamMixture:
    """Return a mixture to begin with: noise by the median of the errors, which outliers spare."""
    off = (z - m)[np.isfinite(m)]
    middle = float(np.median(off))
    sigma_m = max(1.4826 * float(np.median(np.abs(off - middle))), 1e-3)
    return BeamMixture(0.9, 0.03, 0.03, 0.04, sigma_m, middle, 0.5)


def _product(a: Fitted, b: Fitted) -> Fitted:
    """Return the product of two values >= 0 that err independently; one may be undetermined."""
    value = a.value * b.value
    below = math.hypot((a.value - a.low) * b.value, a.value * (b.value - b.low))
    up_a, up_b = a.high - a.value, b.high - b.value
    above = math.hypot(up_a * b.value, a.value * up_b, up_a * up_b)
    return Fitted(value, max(value - below, 0.0), value + above)


def _log_ratio(greater: float, less: float) -> float:
    """Return the log of how many times greater a value is than another, finite."""
    return math.log(max(greater, 1e-12) / max(less, 1e-12))
