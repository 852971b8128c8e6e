"""Parameters of a sonar or lidar, from readings at known poses in a known room.

Three things depend on each other: the surface of a reading on the incidence limit, its expected
echo on the maximum range, and both limits on the mixture. So the incidence limit is found first, by
whether there is an echo at all; then the mixture, without the readings near the greatest range;
then that range; then the mixture again, with all but those that could lie on either side of a
limit.

Readings from edges say little of the sensor and are left out (`EchoExpectations.steady`). The
selection depends on room, pose and the two limits, which all readings together determine, never on
a reading's own error: large errors are left out no more often than small ones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.ranging.fit.expected_ranges import EchoExpectations, Sightlines
from robotctl.estimation.ranging.fit.range_fit import Fitted, RangeFit, best_mixture, fit_ranges
from robotctl.estimation.ranging.fit.range_likelihood import Array
from robotctl.estimation.ranging.fit.range_limits import (
    IncidenceLimit,
    greatest_range,
    incidence_limit,
)

_AROUND: Final = 1.5
"""Distance beyond the longest range within which walls are searched."""
_SAFE: Final = 0.9
"""Readings nearer than this share of the greatest range measured are surely within it."""
_MARGIN_RAD: Final = math.radians(1.0)
_SIGMAS: Final = 4.0
_FADES: Final = 3.0
_HITS: Final = 0.4
_ROUGH: Final = 0.1
_STRETCHES: Final = 100
_LEAST_IN_STRETCH: Final = 20


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """Readings of one kind of sensor at known poses.

    Parameters
    ----------
    lines
        From where, in the order of their times.
    ranges_m
        (m,) [m]; inf: no echo; no nan.
    max_range_m
        The sensor's greatest range [m] where it is known; None: to be found.
    """

    lines: Sightlines
    ranges_m: Array
    max_range_m: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class SensorFit:
    """The result.

    Parameters
    ----------
    ranges
        Mixture and intervals.
    incidence
        The incidence limit.
    greatest_m
        The greatest range [m].
    expected_m, measured_m
        All readings, (m,) [m]; inf: nothing in range, no echo.
    fitted
        Those that the mixture was fitted to, (m,).
    incidences_rad, heard
        The readings that the incidence limit was found by, (n,).
    """

    ranges: RangeFit
    incidence: IncidenceLimit
    greatest_m: Fitted
    expected_m: Array
    measured_m: Array
    fitted: NDArray[np.bool_]
    incidences_rad: Array
    heard: NDArray[np.bool_]

    def within(self, sigmas_m: Array) -> float:
        """Return which share of the fitted ranges lies within 3 of some sigmas, (m,) [m]."""
        both = self.fitted & np.isfinite(self.expected_m) & np.isfinite(self.measured_m)
        off = self.measured_m[both] - self.expected_m[both]
        return float(np.mean(np.abs(off) <= 3.0 * sigmas_m[both]))

    def off_share(self, sigma_m: float) -> float:
        """Return which share of all ranges, edges included, is off by more than 4 sigma [m]."""
        both = np.isfinite(self.expected_m) & np.isfinite(self.measured_m)
        off = self.measured_m[both] - self.expected_m[both] - self.ranges.mixture.offset_m
        return float(np.mean(np.abs(off) > _SIGMAS * sigma_m))


def fit_sensor(expectations: EchoExpectations, readings: Readings) -> SensorFit:
    """Find mixture, incidence limit and greatest range of a sensor.

    Parameters
    ----------
    expectations
        Expected ranges in the room; must reach `reach_m(readings)`.
    readings
        Their readings.

    Raises
    ------
    ValueError
        If the readings are too few or do not fit to the room.
    """
    lines, z = readings.lines, readings.ranges_m
    if np.any(np.isnan(z)):
        raise ValueError("ranges_m must not be nan")
    if not np.any(np.isfinite(z)):
        raise ValueError("no reading with a range")
    heard = np.isfinite(z)
    farthest = readings.max_range_m or float(z[heard].max())
    incidences = expectations.incidences(lines)
    plain = np.isfinite(incidences) & expectations.free_of_edges(lines, incidences)
    at_least = expectations.ranges_at(lines, incidences)
    plain &= at_least < _SAFE * farthest
    incidence = _as_known(incidence_limit(incidences[plain], heard[plain]), expectations.step_rad)
    limit = incidence.limit.value if not incidence.limit.why_not else expectations.open_rad
    sides = _sure_side(incidences, incidence)
    expected = expectations.ranges(lines, limit)
    usable = sides & expectations.steady(lines, limit, expected)

    def chosen(range_m: float, margin_m: float) -> tuple[Array, NDArray[np.bool_]]:
        within = np.where(expected < range_m, expected, np.inf)
        return within, usable & (np.abs(expected - range_m) > margin_m)

    if readings.max_range_m is None:
        range_m = math.nextafter(farthest, math.inf)
        within, some = chosen(range_m, (1.0 - _SAFE) * farthest)
        first = best_mixture(within[some], z[some], range_m)
        greatest = greatest_range(expected[usable], z[usable], first)
        range_m = max(greatest.value, range_m)
        margin_m = _SIGMAS * float(first.sigma_at(np.array(range_m)))
        margin_m += greatest.high - greatest.low if not greatest.why_not else 0.0
    else:
        range_m = readings.max_range_m
        greatest = Fitted(range_m, range_m, range_m, "given, not found")
        margin_m = (1.0 - _SAFE) * range_m
    within, some = chosen(range_m, margin_m)
    found = fit_ranges(within[some], z[some], range_m, _stretches(len(z))[some])
    _check_room(found)
    return SensorFit(found, incidence, greatest, within, z, some, incidences[plain], heard[plain])


def _check_room(found: RangeFit) -> None:
    """Refuse a bad fit: most readings have another cause than the room."""
    hit, typical_m = found.mixture.hit, found.typical_m
    sigma_m = float(found.mixture.sigma_at(np.array(typical_m)))
    if hit < _HITS or sigma_m > _ROUGH * typical_m:
        raise ValueError(
            f"the readings do not match the room: {100 * hit:.0f} % of them hit its surfaces, to "
            f"{sigma_m:.2g} m at {typical_m:.2g} m; at least {100 * _HITS:.0f} % to a "
            f"{1 / _ROUGH:.0f}th of the range are needed. Is it the right map, and are the poses "
            "in its frame?"
        )


def _as_known(found: IncidenceLimit, step_rad: float) -> IncidenceLimit:
    """Return a limit whose interval allows for incidences that are known in steps."""
    limit, half = found.limit, 0.5 * step_rad
    if limit.why_not:
        return found
    wider = replace(limit, low=max(limit.low - half, 0.0), high=limit.high + half)
    return replace(found, limit=wider)


def reach_m(readings: Readings) -> float:
    """Return how far walls must be known for a fit [m]."""
    if readings.max_range_m is not None:
        return readings.max_range_m
    return _AROUND * float(readings.ranges_m[np.isfinite(readings.ranges_m)].max(initial=0.1))


def _sure_side(incidences: Array, found: IncidenceLimit) -> NDArray[np.bool_]:
    """Return which readings are surely below or beyond the incidence limit, (m,)."""
    if found.limit.why_not:
        return np.ones(len(incidences), np.bool_)
    margin = _MARGIN_RAD + _FADES * found.fades_rad
    low, high = found.limit.low - margin, found.limit.high + margin
    sure: NDArray[np.bool_] = (incidences < low) | (incidences > high)
    return sure


def _stretches(readings: int) -> NDArray[np.intp]:
    """Return the number of the stretch that each reading belongs to, (m,)."""
    count = min(max(readings // _LEAST_IN_STRETCH, 1), _STRETCHES)
    return (np.arange(readings) * count) // max(readings, 1)
