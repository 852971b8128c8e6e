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

from robotctl.estimation.mcl.tuning import MonitorConfig

_EVIDENCE: Final = (-2.0, 2.0)
_ADVANTAGE: Final = (10.0, 4.0)
"""Level and scatter of both figures before the first measurement [nat]; they count for
`prior_measurements` only."""


class LikelihoodMonitor:
    """Watches the fit of one sensor's measurements.

    At first a perfect fit is taken to have an evidence of about 0 (`log_likelihood.py`).

    Parameters
    ----------
    config
        When the fit is bad.
    """

    def __init__(self, config: MonitorConfig | None = None) -> None:
        self._config = config or MonitorConfig()
        self._evidence = _Watched(*_EVIDENCE, self._config)
        self._advantage = _Watched(*_ADVANTAGE, self._config)

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
        if fallen > self._config.alarm_alone:
            return True
        return both > self._config.alarm and not any(each._overrules(self) for each in others)

    def _overrules(self, other: LikelihoodMonitor) -> bool:
        """Whether this sensor says more than another one, and nothing against the belief."""
        config = self._config
        is_calm = self._advantage.sum < config.calm and self._evidence.sum < config.calm_evidence
        return is_calm and self._advantage.level > config.says_more * other._advantage.level

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

    def __init__(self, level: float, scatter: float, config: MonitorConfig) -> None:
        self._config = config
        self._count = config.prior_measurements
        self.level = level
        self._variance = scatter**2
        self.sum = 0.0

    @property
    def _scatter(self) -> float:
        return max(math.sqrt(self._variance), self._config.scatter_min)

    def is_low(self, figure: float) -> bool:
        """Whether the sum would grow."""
        return figure < self.level - self._config.slack * self._scatter

    def fallen(self, figure: float) -> float:
        """Take in a figure and return the sum."""
        scatter, config = self._scatter, self._config
        off = (figure - self.level) / scatter
        self.sum = max(0.0, self.sum - min(max(off, -config.clip), config.clip) - config.slack)
        # Learnt from clipped figures, so that a bad fit raises the alarm before it becomes normal.
        most = config.learning_clip
        self._learn(min(max(off, -most), most) * scatter)
        return self.sum

    def _learn(self, off: float) -> None:
        """Move level and variance by a figure that was so far off [nat]."""
        self._count += 1
        gain = max(1.0 / self._count, 1.0 / self._config.memory)
        self.level += gain * off
        self._variance = (1.0 - gain) * (self._variance + gain * off * off)
