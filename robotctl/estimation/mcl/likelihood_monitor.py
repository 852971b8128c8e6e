"""Whether measurements fit a belief worse than they used to.

For a tracked robot two figures of a measurement have a level and a scatter that depend on sensor
and map: its evidence, log p(z | belief), and how far that exceeds the evidence of poses drawn
anywhere. Both are learnt while the robot is localised. A robot that was carried away falls below
both; a crowd or a strange corner below the first alone, an empty place that resembles many others
below the second. A wrong place that resembles the right one can keep its advantage: a long fall of
the evidence is enough.

That is the idea of w_slow and w_fast in augmented MCL (Probabilistic Robotics, table 8.3); here on
logarithms, so that one product of sixty beams does not outweigh all others, and with Page's
cumulated sum as the test (Page 1954, "Continuous inspection schemes"), so that one bad scan is no
alarm and several in a row are.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

_MEMORY: Final = 100
"""Measurements over which level and scatter are averaged."""
_WORTH: Final = 20
"""Weight of the initial assumption about them, in measurements."""
_LEAST_SCATTER: Final = 0.5
"""[nat]."""
_SLACK: Final = 1.0
"""Standard deviations below the level that are still nothing."""
_GREATEST: Final = 4.0
"""Maximum weight of one measurement."""
_LEARNT_FROM: Final = 2.0
"""Maximum change of level and scatter, so that a bad fit is noticed before it is learnt."""
_ALARM: Final = 8.0
"""Sum of standard deviations, less the slack, at which the fit is called bad if both fell."""
_ALARM_ALONE: Final = 40.0
"""The same for the evidence alone. On public lidar logs the sum of a tracked robot reaches 22."""
_CALM: Final = 1.0
"""Sum of the advantage below which a sensor has nothing against the belief: a robot that was moved
by hand exceeds it with the first measurement."""
_CALM_EVIDENCE: Final = 4.0
"""The same of the evidence alone, which falls in a crowd."""
_SAYS_MORE: Final = 1.5
"""A sensor says more than another one if its measurements usually favour the belief by this factor
more."""


class LikelihoodMonitor:
    """Watches the fit of one sensor's measurements.

    At first a perfect fit is taken to have an evidence of about 0 (`log_likelihood.py`).
    """

    def __init__(self) -> None:
        self._evidence = _Watched(level=-2.0, scatter=2.0)
        self._advantage = _Watched(level=10.0, scatter=4.0)

    def is_low(self, evidence: float) -> bool:
        """Whether an evidence is so far below its level that it counts."""
        return self._evidence.is_low(evidence)

    def is_bad(
        self, evidence: float, elsewhere: float, others: Iterable[LikelihoodMonitor] = ()
    ) -> bool:
        """Take in a measurement; return whether the fit has become bad.

        Parameters
        ----------
        evidence, elsewhere
            Log-evidence of the belief, and of poses anywhere; not both -inf.
        others
            Those of other sensors that were heard lately. Somebody beside the robot hides the map
            from one sonar for as long as he stays: a fall of both figures counts only while none of
            the sensors that say more is content with the place.
        """
        fallen = self._evidence.fallen(evidence)
        # Carried away, both fall. A crowd lowers only the first, an ambiguous empty place only the
        # second.
        both = min(fallen, self._advantage.fallen(evidence - elsewhere))
        if fallen > _ALARM_ALONE:
            return True
        return both > _ALARM and not any(each._overrules(self) for each in others)

    def _overrules(self, other: LikelihoodMonitor) -> bool:
        """Whether this sensor says more than another one, and nothing against the belief."""
        is_calm = self._advantage.sum < _CALM and self._evidence.sum < _CALM_EVIDENCE
        return is_calm and self._advantage.level > _SAYS_MORE * other._advantage.level

    def forgive(self) -> None:
        """Begin new sums; levels and scatters stay."""
        self._evidence.sum = 0.0
        self._advantage.sum = 0.0


class _Watched:
    """Level and scatter of a figure [nat], and the sum of its falls [standard deviations].

    Attributes
    ----------
    level, sum
        As they are now.
    """

    def __init__(self, level: float, scatter: float) -> None:
        self._count = _WORTH
        self.level = level
        self._variance = scatter**2
        self.sum = 0.0

    @property
    def _scatter(self) -> float:
        return max(math.sqrt(self._variance), _LEAST_SCATTER)

    def is_low(self, figure: float) -> bool:
        """Whether the sum would grow."""
        return figure < self.level - _SLACK * self._scatter

    def fallen(self, figure: float) -> float:
        """Take in a figure and return the sum."""
        scatter = self._scatter
        off = (figure - self.level) / scatter
        self.sum = max(0.0, self.sum - min(max(off, -_GREATEST), _GREATEST) - _SLACK)
        # Learnt from clipped figures, so that a bad fit raises the alarm before it becomes normal.
        self._learn(min(max(off, -_LEARNT_FROM), _LEARNT_FROM) * scatter)
        return self.sum

    def _learn(self, off: float) -> None:
        """Move level and variance by a figure that was so far off [nat]."""
        self._count += 1
        gain = max(1.0 / self._count, 1.0 / _MEMORY)
        self.level += gain * off
        self._variance = (1.0 - gain) * (self._variance + gain * off * off)
