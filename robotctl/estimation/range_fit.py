"""What a range sensor is like, by what it measured and should have: mixture and intervals.

Expectation maximisation (`range_mixture.learned`) finds the mixture, Newton-like steps take it to
the top of the likelihood. An interval holds all values of a parameter for which the
likelihood, with the other parameters at their best, is not too far below the top (profile
likelihood). Unlike a symmetric interval it is right near a bound too, where a part of the mixture
is rare or absent: then it begins at the bound.

Readings of one moment err together: poses and maps do. So the limit of "too far" is widened, for
each parameter, by how much the sum of its influence over stretches of the log scatters more than
that of independent readings would (the sandwich of Huber 1967, clustered), and by Student's
quantile for the number of stretches.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student  # type: ignore[import-untyped]

from robotctl.estimation.range_likelihood import (
    HIGH,
    LOW,
    NAMES,
    Array,
    RangeLikelihood,
    mixture_of,
    parameters_of,
)
from robotctl.estimation.range_mixture import BeamMixture, learned

_EM_STEPS: Final = 30
_LEAST_HITS: Final = 50
_SPREAD: Final = 1.5
"""How sigma grows is told by hits whose far tenth is so many times as far as their near tenth."""
_CLIMBS: Final = 200
_LITTLE: Final = 1e-6
_SHORT: Final = 1e-4
_SHORTEST: Final = 1e8
_MOST_NO_HITS: Final = 0.98
_STEPS: Final = 10
_NEAR: Final = 0.01
"""Ends of intervals are found to this share of their distance, in so many steps at most."""
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
        Why the data do not tell the value; empty where they do.
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
    """What the readings tell of a sensor.

    Parameters
    ----------
    mixture
        The best one.
    values
        By name: hit, short, none, random, garbage (short and random), sigma_m, sigma_per_m,
        offset_m, short_per_m and robust_k.
    readings, hits
        How many readings there are, and how many of them are hits.
    typical_m
        Median of the expected ranges, for which robust_k holds [m].
    stretches
        Stretches of the log, independent of each other.
    """

    mixture: BeamMixture
    values: dict[str, Fitted]
    readings: int
    hits: float
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
        What was measured, (m,) [m]; inf or at least `max_range_m`: no echo; nan is left out.
    max_range_m
        The sensor's greatest range [m].
    stretches
        Number of the stretch of the log that each reading belongs to, (m,); those of different
        stretches err independently. None: all readings do.

    Returns
    -------
    RangeFit
        Best values, intervals, and why a value is not told.

    Raises
    ------
    ValueError
        If shapes differ, or fewer than 50 readings are hits.
    """
    return _prepared(expected_m, measured_m, max_range_m, stretches).result()


def best_mixture(expected_m: Array, measured_m: Array, max_range_m: float) -> BeamMixture:
    """Return the mixture that fits readings best, as `fit_ranges`, without the intervals."""
    return mixture_of(_prepared(expected_m, measured_m, max_range_m, None).best)


def _prepared(
    expected_m: Array,
    measured_m: Array,
    max_range_m: float,
    stretches: NDArray[np.intp] | None,
) -> _Fit:
    """Check readings and climb to the top of their likelihood."""
    if expected_m.shape != measured_m.shape or expected_m.ndim != 1:
        raise ValueError(
            f"expected_m {expected_m.shape} and measured_m {measured_m.shape} must both be (m,)"
        )
    valid = ~np.isnan(measured_m)
    m, z = expected_m[valid], measured_m[valid]
    m = np.where(m < max_range_m, m, np.inf)
    both = int(np.count_nonzero(np.isfinite(m) & (z < max_range_m)))
    if both < _LEAST_HITS:
        raise ValueError(
            f"{both} readings with a range where one was expected, at least {_LEAST_HITS} needed"
        )
    groups = np.arange(len(z)) if stretches is None else stretches[valid]
    return _Fit(m, z, max_range_m, groups)


class _Fit:
    """The work on one set of readings."""

    def __init__(self, m: Array, z: Array, max_range_m: float, groups: NDArray[np.intp]) -> None:
        heard = z < max_range_m
        order = np.concatenate([np.flatnonzero(heard), np.flatnonzero(~heard)])
        _, self._groups = np.unique(groups[order], return_inverse=True)
        self._likelihood = RangeLikelihood(m[heard], z[heard], np.isfinite(m[~heard]), max_range_m)
        self._grows, self._same = self._spread(m[heard])
        start = learned(_start(m[heard], z[heard]), m, z, max_range_m, _EM_STEPS)
        if self._grows:
            start = learned(start, m, z, max_range_m, _EM_STEPS, sigma_grows=True)
        at = np.clip(parameters_of(start), LOW, HIGH)
        self._scale = np.array([0.01, 0.3, 0.01, start.sigma_m, 0.01, start.sigma_m, 1.0])
        self._free = np.ones(7, np.bool_)
        self._free[4] = self._grows
        self.best, self._top = self._climb(at, self._free)
        self._inside = self._free & (self.best > 1.001 * LOW) & (self.best < 0.999 * HIGH)
        self._naive = np.linalg.pinv(self._information(self._inside))
        self._scale[self._inside] = np.sqrt(np.maximum(np.diag(self._naive), 1e-18))

    @staticmethod
    def _spread(m: Array) -> tuple[bool, float]:
        """Whether hits come from different ranges, and the range that they come from [m]."""
        near, far = np.quantile(m[np.isfinite(m)], [0.1, 0.9]).tolist()
        return far >= _SPREAD * near, 0.5 * (near + far)

    def _climb(self, start: Array, free: NDArray[np.bool_]) -> tuple[Array, float]:
        """Return where the likelihood is greatest with only some parameters free, and its log.

        Steps are those of Berndt, Hall, Hall and Hausman (1974), with the outer products of the
        scores for the curvature, shortened as by Marquardt until they climb. A parameter that
        would leave its bounds stays on them.
        """
        at, short = np.clip(start, LOW, HIGH), _SHORT
        log, score, outer = self._likelihood.total(at)
        for _ in range(_CLIMBS):
            open_ = free & ~((at <= LOW) & (score < 0.0)) & ~((at >= HIGH) & (score > 0.0))
            chosen = np.flatnonzero(open_)
            unit = np.sqrt(np.maximum(np.diag(outer)[chosen], 1e-30))
            curvature = outer[np.ix_(chosen, chosen)] / np.outer(unit, unit)
            curvature[np.diag_indices(len(chosen))] += short
            new = at.copy()
            new[chosen] += np.linalg.solve(curvature, score[chosen] / unit) / unit
            new = np.clip(new, LOW, HIGH)
            gain = -math.inf
            if new[0] + new[2] < _MOST_NO_HITS:
                found = self._likelihood.total(new)
                gain = found[0] - log
            if gain <= 0.0:
                short *= 8.0
                if short > _SHORTEST:
                    break
                continue
            at, (log, score, outer), short = new, found, max(short / 8.0, _SHORT)
            if gain < _LITTLE:
                break
        return at, log

    def result(self) -> RangeFit:
        """Return all values with intervals."""
        self._cuts = self._limits()
        values = {name: self._profile(i) for i, name in enumerate(NAMES)}
        values |= self._parts(values)
        mixture = mixture_of(self.best)
        expected = self._likelihood.expected_m
        typical_m = float(np.median(expected[np.isfinite(expected)]))
        values["robust_k"] = self._robust_k(mixture, values, typical_m)
        del values["short_share"]
        self._say(values)
        heard = len(self._likelihood.measured_m)
        readings = heard + len(self._likelihood.missing)
        hits = heard - self.best[0] * readings
        return RangeFit(mixture, values, readings, hits, typical_m, self._stretches)

    @property
    def _stretches(self) -> int:
        """Number of stretches."""
        return int(self._groups.max()) + 1

    def _limits(self) -> Array:
        """Return by how much twice the log-likelihood may fall for each parameter, (7,)."""
        _, score = self._likelihood.logs(self.best)
        inside, naive = self._inside, self._naive
        count = self._stretches
        ratio: Array = np.ones(7)
        influence = score[:, inside] @ naive
        summed = np.zeros((count, influence.shape[1]))
        np.add.at(summed, self._groups, influence)
        variance = np.sum(summed**2, axis=0) * count / max(count - 1, 1)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio[inside] = np.nan_to_num(variance / np.diag(naive), nan=1.0)
        # On a bound the score alone tells how readings of a stretch go together.
        for i in np.flatnonzero(self._free & ~inside):
            single = score[:, i] - score[:, i].mean()
            own = float(np.sum(single**2))
            together = float(np.sum(np.bincount(self._groups, single, count) ** 2))
            ratio[i] = together / own if own > 0.0 else 1.0
        quantile: float = student.ppf(0.975, max(count - 1, 1))
        cuts: Array = quantile**2 * np.maximum(ratio, 1.0)
        return cuts

    def _information(self, inside: NDArray[np.bool_]) -> Array:
        """Return the observed information of some parameters, by differences of the score."""
        rows = []
        for i in np.flatnonzero(inside):
            step = np.zeros(7)
            step[i] = 1e-4 * min(self._scale[i], abs(self.best[i]) + 1e-3 * self._scale[i])
            more = self._likelihood.total(self.best + step)[1]
            less = self._likelihood.total(self.best - step)[1]
            rows.append((less - more)[inside] / (2.0 * step[i]))
        differences = np.array(rows)
        information: Array = 0.5 * (differences + differences.T)
        return information

    def _profile(self, i: int) -> Fitted:
        """Return a parameter with its interval by profile likelihood."""
        value = float(self.best[i])
        if not self._free[i]:
            return Fitted(value, value, value)
        return Fitted(value, self._end(i, LOW[i], -1.0), self._end(i, HIGH[i], 1.0))

    def _end(self, i: int, bound: float, sign: float) -> float:
        """Return where the likelihood has fallen to the limit, or the bound.

        The root of the fall is nearly linear in the distance, so a rule of three converges.
        """
        value, wanted = float(self.best[i]), math.sqrt(float(self._cuts[i]))
        width = wanted * float(self._scale[i])
        room = sign * (bound - value)
        near, far = 0.0, math.inf
        for _ in range(_STEPS):
            width = min(width, room)
            fallen = self._fall(i, value + sign * width)
            if fallen <= wanted and width >= room:
                return bound
            if abs(fallen - wanted) <= _NEAR * wanted:
                break
            near, far = (width, far) if fallen < wanted else (near, width)
            guess = width * wanted / max(fallen, 0.1 * wanted)
            width = guess if near < guess < far else 0.5 * (near + min(far, 10.0 * width))
        return value + sign * width

    def _fall(self, i: int, value: float) -> float:
        """Return the root of twice the fall of the log-likelihood with one parameter held."""
        others = self._free.copy()
        others[i] = False
        at = self.best.copy()
        if self._inside[i]:
            # Where the others go, to first order.
            k = int(np.count_nonzero(self._inside[:i]))
            at[self._inside] += (value - at[i]) * self._naive[:, k] / self._naive[k, k]
        at[i] = value
        if i in (0, 2):  # the parts leave something for hits
            at[2 - i] = min(at[2 - i], 0.95 - value)
        _, top = self._climb(np.clip(at, LOW, HIGH), others)
        return math.sqrt(max(2.0 * (self._top - top), 0.0))

    def _parts(self, values: dict[str, Fitted]) -> dict[str, Fitted]:
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
        self, mixture: BeamMixture, values: dict[str, Fitted], typical_m: float
    ) -> Fitted:
        """Return K at the typical range: as uncertain as garbage, sigma and hit together."""
        k = mixture.robust_k(typical_m, self._likelihood.max_range_m)
        parts = [values["garbage"], values["hit"], values["sigma_m"]]
        below = math.sqrt(sum(_log_ratio(p.value, p.low) ** 2 for p in parts))
        above = math.sqrt(sum(_log_ratio(p.high, p.value) ** 2 for p in parts))
        return Fitted(k, k * math.exp(-below), k * math.exp(above))

    def _say(self, values: dict[str, Fitted]) -> None:
        """Mark what the data do not tell."""
        why: dict[str, str] = {}
        if not self._grows:
            why["sigma_per_m"] = (
                f"all echoes come from about {self._same:.2g} m, so how the noise grows with the "
                "range cannot be told; sigma_m holds there"
            )
        rate = values["short_per_m"]
        if values["short"].low < 1e-6 or rate.high > _RATE_FOLD * max(rate.low, 1e-2):
            why["short_per_m"] = (
                f"about {values['short'].value * len(self._groups):.0f} readings are short, too "
                "few to tell how they are spread"
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
    """Return the product of two values >= 0 that err independently; one may be told by nothing."""
    value = a.value * b.value
    below = math.hypot((a.value - a.low) * b.value, a.value * (b.value - b.low))
    up_a, up_b = a.high - a.value, b.high - b.value
    above = math.hypot(up_a * b.value, a.value * up_b, up_a * up_b)
    return Fitted(value, max(value - below, 0.0), value + above)


def _log_ratio(greater: float, less: float) -> float:
    """Return the log of how many times greater a value is than another, finite."""
    return math.log(max(greater, 1e-12) / max(less, 1e-12))
