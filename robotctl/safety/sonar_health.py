"""The ring of sonars as control sees it: the newest range of each, and which are silent."""

from __future__ import annotations

import math

from robotctl.messages.actuators import NEVER_NS
from robotctl.messages.control import SonarFeedback
from robotctl.messages.faults import Fault
from robotctl.safety.ages import AgeLimit, fresh_span_ns, is_fresh


class SonarHealth:
    """Keeps the newest ranges and judges their age.

    Parameters
    ----------
    names
        Names of the sonars of the ring; empty if none is used.
    age
        Maximum age of a range; None where there is no sonar.

    Attributes
    ----------
    ranges_m
        Newest range of each [m].
    stamps_ns
        Time of the last range that was one [ns]; a sonar's own fault does not count.
    """

    def __init__(self, names: tuple[str, ...], age: AgeLimit | None) -> None:
        self.ranges_m = [math.nan] * len(names)
        self.stamps_ns = [NEVER_NS] * len(names)
        self._names = names
        self._age = age
        self._limit_ns = 0 if age is None else age.limit_ns
        self._fresh_ns = fresh_span_ns(self.stamps_ns, self._limit_ns)

    def update(self, sonars: tuple[SonarFeedback, ...]) -> None:
        """Take the ranges of some groups."""
        for sonar in sonars:
            for index, range_m in enumerate(sonar.ranges_m, sonar.first):
                if index < len(self.ranges_m):
                    self.ranges_m[index] = range_m
                    # A missing measurement does not renew the age of the last one.
                    if not math.isnan(range_m):
                        self.stamps_ns[index] = sonar.stamp_ns
        self._fresh_ns = fresh_span_ns(self.stamps_ns, self._limit_ns)

    def fresh_m(self, now_ns: int) -> tuple[float, ...]:
        """Return the range of each sonar [m]; inf: no echo; nan: too old, or none at all."""
        limit_ns = self._limit_ns
        return tuple(
            range_m if is_fresh(stamp_ns, now_ns, limit_ns) else math.nan
            for range_m, stamp_ns in zip(self.ranges_m, self.stamps_ns, strict=True)
        )

    def faults(self, now_ns: int) -> list[Fault]:
        """Return which sonars have been silent for too long."""
        age, limit_ns, (first_ns, last_ns) = self._age, self._limit_ns, self._fresh_ns
        if age is None or first_ns <= now_ns <= last_ns:
            return []
        silence = f"{age.words} {limit_ns / 1e6:g} ms"
        return [
            Fault(age.code, f"sonar {name} {silence}", name)
            for name, stamp_ns in zip(self._names, self.stamps_ns, strict=True)
            if not is_fresh(stamp_ns, now_ns, limit_ns)
        ]
