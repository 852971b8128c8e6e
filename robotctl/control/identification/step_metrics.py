"""Rise time, overshoot, settling time and steady-state error of a recorded step response.

The terms are those of IEC 60050-351 and of K. Ogata, *Modern Control Engineering*, 5th ed.,
section 5-3: rise from 10 % to 90 % of the step, overshoot beyond the reference as a fraction of the
step, settling as the last entry into a band around the reference.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, slots=True)
class StepMetrics:
    """Quality of one step response. Times count from the step of the reference.

    Parameters
    ----------
    rise_s
        Time from 10 % to 90 % of the step [s]; None if 90 % is never reached.
    overshoot
        Maximum excursion beyond the reference, as a fraction of the step, >= 0.
    settling_s
        Time from which the response stays within the band [s]; None if it ends outside.
    steady_state_error
        Reference minus mean of the record's last part, as a signed fraction of the step; positive
        if the response stays short.
    peak_s
        Time of the maximum excursion in the direction of the step [s].
    """

    rise_s: float | None
    overshoot: float
    settling_s: float | None
    steady_state_error: float
    peak_s: float


def step_metrics(
    time_s: ArrayLike,
    response: ArrayLike,
    reference: float,
    initial: float = 0.0,
    step_time_s: float = 0.0,
    band: float = 0.02,
    steady_share: float = 0.2,
) -> StepMetrics:
    """Return the metrics of a response to a step of the reference from `initial`.

    Times of crossings are interpolated between samples.

    Parameters
    ----------
    time_s
        Sample times, shape (n,), increasing [s]; samples before the step are left out.
    response
        Measured values, shape (n,), in the unit of the reference.
    reference, initial
        Value of the reference after and before the step; they must differ.
    step_time_s
        Time of the reference's step [s].
    band
        Half width of the settling band as a fraction of the step, (0, 1).
    steady_share
        Last fraction of the time after the step that counts as steady, (0, 1].

    Raises
    ------
    ValueError
        If the record has fewer than two samples after the step, is not finite or not in order of
        time, or a parameter is outside its range.
    """
    t, y = _record(time_s, response)
    if reference == initial:
        raise ValueError(f"reference: {reference} found, a value other than initial allowed")
    if not 0.0 < band < 1.0:
        raise ValueError(f"band: {band} found, (0, 1) allowed")
    if not 0.0 < steady_share <= 1.0:
        raise ValueError(f"steady_share: {steady_share} found, (0, 1] allowed")
    after = t >= step_time_s
    if np.count_nonzero(after) < 2:
        raise ValueError(f"time_s: fewer than two samples at or after the step at {step_time_s} s")
    t = t[after] - step_time_s
    done = (y[after] - initial) / (reference - initial)
    ten, ninety = _first_crossing(t, done, 0.1), _first_crossing(t, done, 0.9)
    steady = t >= t[-1] - steady_share * (t[-1] - t[0])
    peak = int(np.argmax(done))
    return StepMetrics(
        rise_s=None if ten is None or ninety is None else ninety - ten,
        overshoot=max(0.0, float(done[peak]) - 1.0),
        settling_s=_settling(t, np.abs(done - 1.0), band),
        steady_state_error=1.0 - float(np.mean(done[steady])),
        peak_s=float(t[peak]),
    )


def _record(
    time_s: ArrayLike, values: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a record as checked arrays."""
    t, y = np.asarray(time_s, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if t.ndim != 1 or t.shape != y.shape:
        raise ValueError(f"record: shapes {t.shape} and {y.shape} found, (n,) for both allowed")
    if not (np.all(np.isfinite(t)) and np.all(np.isfinite(y))):
        raise ValueError("record: a value is not finite")
    if np.any(np.diff(t) <= 0.0):
        raise ValueError("time_s: not increasing")
    return t, y


def _crossing(t: NDArray[np.float64], y: NDArray[np.float64], i: int, level: float) -> float:
    """Return the time at which the line from sample i to i + 1 passes the level."""
    return float(t[i] + (level - y[i]) / (y[i + 1] - y[i]) * (t[i + 1] - t[i]))


def _first_crossing(t: NDArray[np.float64], y: NDArray[np.float64], level: float) -> float | None:
    """Return the time at which y first reaches the level; None if never."""
    reached = np.flatnonzero(y >= level)
    if reached.size == 0:
        return None
    first = int(reached[0])
    return float(t[0]) if first == 0 else _crossing(t, y, first - 1, level)


def _settling(t: NDArray[np.float64], error: NDArray[np.float64], band: float) -> float | None:
    """Return the time of the error's last entry into the band; None if it ends outside."""
    outside = np.flatnonzero(error > band)
    if outside.size == 0:
        return float(t[0])
    last = int(outside[-1])
    return None if last == t.size - 1 else _crossing(t, error, last, band)
