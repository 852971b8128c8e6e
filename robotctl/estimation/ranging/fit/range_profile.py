"""Intervals of the mixture's parameters by profile likelihood.

An interval holds all values of a parameter for which the likelihood, with the other parameters at
their best, is not too far below the top. Unlike a symmetric interval it is right near a bound too,
where a part of the mixture is rare or absent: then it begins at the bound.

Readings of one moment err together: poses and maps do. So the limit of "too far" is widened, for
each parameter, by how much the sum of its influence over stretches of the log scatters more than
that of independent readings would (the sandwich of Huber 1967, clustered), and by Student's
quantile for the number of stretches.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student  # type: ignore[import-untyped]

from robotctl.estimation.ranging.fit.range_likelihood import HIGH, LOW, Array, RangeLikelihood

_CLIMBS: Final = 200
_LITTLE: Final = 1e-6
_SHORT: Final = 1e-4
_SHORTEST: Final = 1e8
_MOST_NO_HITS: Final = 0.98
_STEPS: Final = 10
_NEAR: Final = 0.01
"""Relative accuracy of interval ends, and the maximum steps to find them."""


class RangeProfile:
    """The top of the likelihood of readings, and how it falls from there.

    Parameters
    ----------
    likelihood
        Of the readings.
    stretches
        Number of the stretch of the log of each reading, from 0, in the order of the likelihood.
    start
        Parameters near the top, (7,).
    free
        Which of them are to be found, (7,).
    """

    def __init__(
        self,
        likelihood: RangeLikelihood,
        stretches: NDArray[np.intp],
        start: Array,
        free: NDArray[np.bool_],
    ) -> None:
        self._likelihood = likelihood
        self._groups = stretches
        self.stretches = int(stretches.max()) + 1
        self._free = free
        self._scale = np.array([0.01, 0.3, 0.01, start[3], 0.01, start[3], 1.0])
        self.best, self._top = self._climb(start, free)
        self._inside = free & (self.best > 1.001 * LOW) & (self.best < 0.999 * HIGH)
        self._naive = np.linalg.pinv(self._information(self._inside))
        self._scale[self._inside] = np.sqrt(np.maximum(np.diag(self._naive), 1e-18))

    def interval(self, i: int) -> tuple[float, float]:
        """Return the ends of the 95 % interval of a parameter; its value twice where not free."""
        if not self._free[i]:
            return float(self.best[i]), float(self.best[i])
        cut = self._cut(i)
        return self._end(i, cut, float(LOW[i]), -1.0), self._end(i, cut, float(HIGH[i]), 1.0)

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

    def _cut(self, i: int) -> float:
        """Return by how much the root of twice the log-likelihood may fall for a parameter."""
        _, score = self._likelihood.logs(self.best)
        count = self.stretches
        if self._inside[i]:
            k = int(np.count_nonzero(self._inside[:i]))
            influence = score[:, self._inside] @ self._naive[:, k]
            together = float(np.sum(np.bincount(self._groups, influence, count) ** 2))
            alone = float(self._naive[k, k])
        else:  # on a bound the score alone tells how readings of a stretch go together
            influence = score[:, i] - score[:, i].mean()
            together = float(np.sum(np.bincount(self._groups, influence, count) ** 2))
            alone = float(np.sum(influence**2))
        ratio = together / alone * count / max(count - 1, 1) if alone > 0.0 else 1.0
        return float(student.ppf(0.975, max(count - 1, 1))) * math.sqrt(max(ratio, 1.0))

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

    def _end(self, i: int, wanted: float, bound: float, sign: float) -> float:
        """Return where the likelihood has fallen to the limit, or the bound.

        The root of the fall is nearly linear in the distance, so a rule of three converges.
        """
        value = float(self.best[i])
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
