"""Filters of raw ranges over time: running median and exponential smoothing.

Both take the readings of k sensors at once: inf is no echo, nan a sensor that did not fire or
failed this time. Such a sensor keeps its state and its output; before its first reading the output
is nan. So sensors that fire in groups, in turn, need no care.

A filter buys calm with delay. Each states its own in readings of one sensor; multiply by the time
between two readings. At a speed v a range is late by v times that.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


class RunningMedian:
    """The median of the last readings of each sensor.

    It passes a step unchanged, `latency_readings` late, and removes bursts of up to that many wrong
    readings, missing echoes among them. No echo counts as farther than all ranges. The median of an
    even number of readings, while the window fills, is the lower of both in the middle, so that the
    output is always a reading.

    Parameters
    ----------
    sensors
        How many, > 0.
    window
        Readings looked at, odd, > 0.

    Raises
    ------
    ValueError
        If a number is out of its range, or `window` is even.
    """

    def __init__(self, sensors: int, window: int = 5) -> None:
        if sensors < 1:
            raise ValueError(f"sensors must be >= 1, found {sensors}")
        if window < 1 or window % 2 == 0:
            raise ValueError(f"window must be odd and >= 1, found {window}")
        self._last = np.full((sensors, window), math.nan)
        self._count = np.zeros(sensors, dtype=np.intp)

    @property
    def latency_readings(self) -> int:
        """How late a step comes out [readings]."""
        return (self._last.shape[1] - 1) // 2

    def reset(self) -> None:
        """Forget all readings."""
        self._last.fill(math.nan)
        self._count.fill(0)

    def update(self, ranges_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Take in one reading of each sensor, (k,) [m]; return the medians, (k,) [m].

        Raises
        ------
        ValueError
            If there is not one reading for each sensor.
        """
        _check(ranges_m, len(self._last))
        fired = np.flatnonzero(~np.isnan(ranges_m))
        self._last[fired, self._count[fired] % self._last.shape[1]] = ranges_m[fired]
        self._count[fired] += 1
        present = np.minimum(self._count, self._last.shape[1])
        ordered = np.sort(self._last, axis=1)  # nan comes last, inf before it
        found: NDArray[np.float64] = ordered[
            np.arange(len(ordered)), (np.maximum(present, 1) - 1) // 2
        ]
        return found


class Smoothing:
    """The exponentially weighted mean of the ranges of each sensor.

    A missing echo has no range to average: it passes at once, and the next range restarts the
    average. Put a `RunningMedian` before it where single echoes go missing or wrong.

    Parameters
    ----------
    sensors
        How many, > 0.
    gain
        Share of the newest range in the output, in (0, 1]. White noise comes out with the
        standard deviation of sqrt(gain / (2 - gain)) of what went in.

    Raises
    ------
    ValueError
        If a number is out of its range.
    """

    def __init__(self, sensors: int, gain: float = 0.4) -> None:
        if sensors < 1:
            raise ValueError(f"sensors must be >= 1, found {sensors}")
        if not 0.0 < gain <= 1.0:
            raise ValueError(f"gain must be in (0, 1], found {gain}")
        self._gain = gain
        self._mean = np.full(sensors, math.nan)

    @property
    def latency_readings(self) -> float:
        """How late a range that changes steadily comes out [readings]."""
        return (1.0 - self._gain) / self._gain

    def reset(self) -> None:
        """Forget all readings."""
        self._mean.fill(math.nan)

    def update(self, ranges_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Take in one reading of each sensor, (k,) [m]; return the means, (k,) [m].

        Raises
        ------
        ValueError
            If there is not one reading for each sensor.
        """
        _check(ranges_m, len(self._mean))
        fired = ~np.isnan(ranges_m)
        goes_on = np.isfinite(ranges_m) & np.isfinite(self._mean)
        self._mean[goes_on] += self._gain * (ranges_m[goes_on] - self._mean[goes_on])
        begins = fired & ~goes_on
        self._mean[begins] = ranges_m[begins]
        return self._mean.copy()


def _check(ranges_m: NDArray[np.float64], sensors: int) -> None:
    """Refuse readings of another number of sensors."""
    if ranges_m.shape != (sensors,):
        raise ValueError(
            f"ranges_m must have one reading for each of {sensors} sensors, found {ranges_m.shape}"
        )
