"""Incidence and range limits of a sensor from readings, with intervals.

**Incidence.** Of readings that met their surface at an angle below the limit nearly all have an
echo, of those beyond nearly none. Where this is a sharp step the limit lies between two readings,
and the likelihood is a staircase that no normal approximation fits. The posterior for a limit that
may lie anywhere, with both probabilities of an echo integrated out (Beta-binomial, Jeffreys), has
the right coverage for such a change point. Where a logistic curve fits clearly better, the sensor
fades out; the limit is then where it has lost half, with an interval by profile likelihood.

**Range.** No range is beyond the greatest one, and echoes that should come from beyond are missing.
The posterior of the greatest range follows from both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize  # type: ignore[import-untyped]
from scipy.special import betaln, expit, ndtr  # type: ignore[import-untyped]

from robotctl.estimation.ranging.fit.range_fit import Fitted
from robotctl.estimation.ranging.fit.range_likelihood import Array
from robotctl.estimation.ranging.range_mixture import BeamMixture, densities

_TAIL: Final = 0.025
_LEAST: Final = 8
"""Readings beyond a limit that show that there is one."""
_ENDS: Final = 0.5
"""Echoes end where less than this share of them is left."""
_BIN_RAD: Final = math.radians(0.25)
_CLEARLY: Final = 4.0
"""A logistic curve is taken if its log-likelihood is better than the step's by this."""
_CHI2: Final = 3.84
_GRID: Final = 4000


@dataclass(frozen=True, slots=True)
class IncidenceLimit:
    """How the share of echoes falls with the incidence.

    Parameters
    ----------
    limit
        Greatest incidence with an echo [rad].
    fades_rad
        Scale of the logistic curve [rad]; 0 for a step.
    """

    limit: Fitted
    fades_rad: float = 0.0


def incidence_limit(incidence_rad: Array, heard: NDArray[np.bool_]) -> IncidenceLimit:
    """Find the incidence limit.

    Parameters
    ----------
    incidence_rad
        At which each reading met its surface, (m,), in [0, pi/2] [rad].
    heard
        Whether it has an echo, (m,).

    Raises
    ------
    ValueError
        If there is no reading.
    """
    if len(incidence_rad) == 0:
        raise ValueError("no reading with a known incidence")
    order = np.argsort(incidence_rad, kind="stable")
    angles, echoes = incidence_rad[order], heard[order]
    logs, below, above = _steps(echoes)
    edges = np.concatenate([[0.0], angles, [0.5 * math.pi]])
    low, middle, high = _quantiles(edges, logs)
    best = int(np.searchsorted(angles, middle))
    shares = float(below[best]), float(above[best])
    if len(angles) - best < _LEAST or not shares[1] < _ENDS * shares[0]:
        # The limit is beyond all angles from which some echoes come.
        still = angles[echoes][-_LEAST:]
        reached = float(still[0]) if len(still) else 0.0
        why = (
            f"echoes do not end up to {math.degrees(reached):.0f} deg of incidence, the greatest "
            "in the data: the limit is above that"
        )
        return IncidenceLimit(Fitted(0.5 * math.pi, reached, 0.5 * math.pi, why))
    step = IncidenceLimit(Fitted(middle, low, high))
    return _logistic(angles, echoes, middle, shares) or step


def _steps(echoes: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
    """Return for a limit behind each of the first j readings: log marginal, shares below, above."""
    n = len(echoes)
    count = np.arange(n + 1)
    heard = np.concatenate([[0], np.cumsum(echoes)])
    others, heard_above = n - count, heard[-1] - heard
    logs = betaln(heard + 0.5, count - heard + 0.5)
    logs += betaln(heard_above + 0.5, others - heard_above + 0.5)
    with np.errstate(invalid="ignore"):
        below, above = heard / count, heard_above / others
    logs[1:-1][below[1:-1] <= above[1:-1]] = -math.inf
    return logs, below, above


def _quantiles(edges: Array, logs: Array) -> tuple[float, float, float]:
    """Return the ends and the middle of a posterior that is constant between edges."""
    mass = np.diff(edges) * np.exp(logs - logs.max())
    whole = np.concatenate([[0.0], np.cumsum(mass)])
    whole /= whole[-1]
    low, middle, high = np.interp([_TAIL, 0.5, 1.0 - _TAIL], whole, edges).tolist()
    return low, middle, high


def _logistic(
    angles: Array, echoes: NDArray[np.bool_], at: float, shares: tuple[float, float]
) -> IncidenceLimit | None:
    """Return the limit by a logistic curve, or None if the step fits as well.

    That is a step `at` an incidence [rad], with the shares of echoes below and above.
    """
    bins = (angles / _BIN_RAD).astype(np.intp)
    count = np.bincount(bins).astype(np.float64)
    heard = np.bincount(bins, echoes)
    centre = (np.arange(len(count)) + 0.5) * _BIN_RAD
    used = count > 0
    count, heard, centre = count[used], heard[used], centre[used]

    def cost(x: Array, limit: float) -> float:
        top, bottom = expit(x[1]), expit(x[2])
        p = bottom + (top - bottom) * expit((limit - centre) / math.exp(x[0]))
        p = np.clip(p, 1e-9, 1.0 - 1e-9)
        return -float(np.sum(heard * np.log(p) + (count - heard) * np.log1p(-p)))

    def logit(p: float) -> float:
        p = min(max(p, 1e-3), 1.0 - 1e-3)
        return math.log(p / (1.0 - p))

    start = np.array([math.log(0.05), *map(logit, shares)])
    whole = minimize(lambda x: cost(x[1:], x[0]), np.concatenate([[at], start]), method="BFGS")
    sharp = cost(np.array([math.log(1e-4), *start[1:]]), at)
    width = math.exp(float(whole.x[1]))
    if -whole.fun < -sharp + _CLEARLY or not _BIN_RAD < width < 0.5:
        return None
    best, ends = float(whole.x[0]), []
    for sign in (-1.0, 1.0):
        inner, outer, x = 0.0, 3.0 * width, whole.x[1:]
        for _ in range(12):
            middle = 0.5 * (inner + outer)
            found = minimize(cost, x, args=(best + sign * middle,), method="BFGS")
            inside = 2.0 * (found.fun - whole.fun) < _CHI2
            inner, outer = (middle, outer) if inside else (inner, middle)
        ends.append(best + sign * outer)
    return IncidenceLimit(Fitted(best, ends[0], ends[1]), width)


def greatest_range(expected_m: Array, measured_m: Array, mixture: BeamMixture) -> Fitted:
    """Find the sensor's greatest range.

    Parameters
    ----------
    expected_m
        How far each reading should go, (m,) [m], whatever the sensor's range; inf: nothing there.
    measured_m
        Measured ranges, (m,) [m]; inf: no echo.
    mixture
        Other knowledge of the sensor.

    Raises
    ------
    ValueError
        If no reading has a range.
    """
    heard = np.isfinite(measured_m)
    if not heard.any():
        raise ValueError("no reading with a range")
    steps = np.diff(np.unique(measured_m[heard]))
    # Readings are rounded: the largest represents all within half a step.
    least = float(measured_m[heard].max() - 0.5 * steps.min(initial=0.01))
    missing = np.sort(expected_m[~heard & np.isfinite(expected_m) & (expected_m > least)])
    if len(missing) < _LEAST:
        why = (
            f"{len(missing)} echoes are missing that should come from beyond {least:.3g} m, the "
            f"greatest range measured: the limit is at least that, and may be farther"
        )
        return Fitted(least, least, math.inf, why)
    grid = np.linspace(least, float(missing[_LEAST - 1]), _GRID)
    logs = _range_logs(grid, expected_m, measured_m, heard, mixture)
    low, middle, high = _quantiles(np.append(grid, grid[-1]), logs)
    return Fitted(middle, low, high)


def _range_logs(
    grid: Array,
    expected_m: Array,
    measured_m: Array,
    heard: NDArray[np.bool_],
    mixture: BeamMixture,
) -> Array:
    """Return the log-likelihood of greatest ranges, but for what does not hang on them."""
    logs = np.zeros(len(grid))
    sigma = mixture.sigma_at(np.where(np.isfinite(expected_m), expected_m, 0.0))
    near = np.isfinite(expected_m) & (expected_m > grid[0] - 6.0 * sigma)
    near &= expected_m < grid[-1]
    for m, s in zip(expected_m[near & ~heard], sigma[near & ~heard], strict=True):
        lost = mixture.none + mixture.hit * ndtr((m + mixture.offset_m - grid) / s)
        logs += np.where(grid > m, np.log(lost), math.log(mixture.none + mixture.hit))
    chosen = near & heard
    garbage = (mixture.short + mixture.random) / grid[0]
    hit, short = densities(mixture, expected_m[chosen], measured_m[chosen], float(grid[-1]))
    gain = np.log(hit + short + mixture.random / grid[0]) - math.log(garbage)
    for m, g in zip(expected_m[chosen], gain, strict=True):
        logs += np.where(grid > m, g, 0.0)
    return logs
