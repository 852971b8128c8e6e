"""New sonar readings in a stream of control states, each at the time of its sound."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from robotctl.model.sensors.sonar import SonarReading, listening_ns

_MAX_AGE_NS: Final = 500_000_000


class NewSonarReadings:
    """Selects new readings; a control state repeats each range until the next one.

    Parameters
    ----------
    max_range_m
        Listening range of the sonars [m].
    """

    def __init__(self, max_range_m: float) -> None:
        self._max_range_m = max_range_m
        self._last_ns = 0

    def take(
        self, now_ns: int, stamps_ns: Sequence[int], ranges_m: Sequence[float]
    ) -> list[SonarReading]:
        """Return the readings that are new in a control state, oldest first.

        Parameters
        ----------
        now_ns
            Time of the state.
        stamps_ns, ranges_m
            Arrival time and value of each sonar's range [m]; nan: no reading.
        """
        oldest_ns = max(self._last_ns, now_ns - _MAX_AGE_NS)
        readings = []
        for came_ns in sorted({stamp_ns for stamp_ns in stamps_ns if stamp_ns > oldest_ns}):
            self._last_ns = came_ns
            heard = tuple(
                range_m if stamp_ns == came_ns else math.nan
                for stamp_ns, range_m in zip(stamps_ns, ranges_m, strict=True)
            )
            if not all(map(math.isnan, heard)):
                sent_ns = came_ns - listening_ns(heard, self._max_range_m)
                readings.append(SonarReading(sent_ns, heard))
        return readings
