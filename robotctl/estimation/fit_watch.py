"""Whether measurements fit a belief worse than they used to.

The evidence of a measurement, log p(z | belief), has for a tracked robot a level and a scatter that
depend on sensor and map, and are learnt while it is localised. A robot that was carried away falls
below them. That is the idea of w_slow and w_fast in augmented MCL (Probabilistic Robotics, table
8.3); here on logarithms, so that one product of sixty beams does not outweigh all others, and with
Page's cumulated sum as the test (Page 1954, "Continuous inspection schemes"), so that one bad scan
is no alarm and several in a row are.
"""

from __future__ import annotations

import math
from typing import Final

_MEMORY: Final = 100
"""Measurements over which level and scatter are averaged."""
_LEVEL: Final = -2.0
_SCATTER: Final = 2.0
_WORTH: Final = 20
"""Level and scatter [nat] that are assumed before anything is learnt, worth so many measurements: a
perfect fit has about 0 (`log_likelihood.py`)."""
_LEAST_SCATTER: Final = 0.5
"""Of the evidence [nat]."""
_SLACK: Final = 1.0
"""Standard deviations below the level that are still nothing."""
_GREATEST: Final = 4.0
"""One measurement counts for at most so many."""
_LEARNT_FROM: Final = 2.0
"""Level and scatter are moved by at most so many, lest a bad fit be learnt before it is noticed."""
_ALARM: Final = 10.0
"""Sum of standard deviations, less the slack, at which the fit is called bad."""


class FitWatch:
    """Level, scatter and cumulated fall of the evidence of one sensor."""

    def __init__(self) -> None:
        self._count = _WORTH
        self._level = _LEVEL
        self._variance = _SCATTER**2
        self._fallen = 0.0

    def forgive(self) -> None:
        """Begin a new sum; level and scatter stay."""
        self._fallen = 0.0

    def is_bad(self, evidence: float) -> bool:
        """Take in the evidence [nat] of a measurement; return whether the fit has become bad."""
        scatter = max(math.sqrt(self._variance), _LEAST_SCATTER)
        off = min(max((evidence - self._level) / scatter, -_GREATEST), _GREATEST)
        self._fallen = max(0.0, self._fallen - off - _SLACK)
        self._learn(min(max(off, -_LEARNT_FROM), _LEARNT_FROM) * scatter)
        return self._fallen > _ALARM

    def _learn(self, off: float) -> None:
        """Move level and variance by a measurement that was so far off [nat]."""
        self._count += 1
        gain = max(1.0 / self._count, 1.0 / _MEMORY)
        self._level += gain * off
        self._variance = (1.0 - gain) * (self._variance + gain * off * off)
