"""Sweeps unwound without odometry: by the motion that the scans themselves show.

A scan that was unwound by a wrong velocity is sheared. Told as from the middle of its sweep, it is
sheared to either side alike, so it matches the last one at the right pose nevertheless; told as
from the end, half the error would go into the pose and swing on from scan to scan.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from robotctl.estimation.ranging.unwinding import unwound_view
from robotctl.estimation.slam.front_end.surface import surface_of
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.keyframes.keyframe import Keyframe, match_pair
from robotctl.model.geometry.se2 import SE2, Tangent2
from robotctl.model.sensors.range_scan import RangeScan

_STEADY_S: Final = 0.5
"""Longest time between two scans over which a velocity is taken as constant [s]."""
_ROUNDS: Final = 2
"""How often a scan is unwound by what was matched, and matched again."""
_WIDE_M: Final = 0.5
"""Distance within which echoes of two scans are matched at first [m]."""


class OwnMotion:
    """Makes views as of one time, from scan to scan at a velocity of their own."""

    def __init__(self) -> None:
        self._config = KeyframeConfig()
        self._last: RangeScan | None = None
        """Last view, as from the middle of its sweep."""
        self._velocity = Tangent2(0.0, 0.0, 0.0)
        """Velocity of `base` [m/s, m/s, rad/s]."""

    def straight(self, view: RangeScan) -> RangeScan:
        """Return a view as of its time; one that needs nothing as it is."""
        if not any(part.sweep_s or part.stamp_ns != view.stamp_ns for part in view.parts):
            return view
        since_s = 0.0 if self._last is None else 1e-9 * (view.stamp_ns - self._last.stamp_ns)
        if self._last is None or not 0.0 < since_s <= _STEADY_S:
            self._velocity = Tangent2(0.0, 0.0, 0.0)
        else:
            self._measure(view, Keyframe(self._last, 0.0), since_s)
        result = self._unwound(view)
        middle = self._middle(result, view)
        self._last = middle if len(surface_of(middle).points) else None
        return result

    def _measure(self, view: RangeScan, last: Keyframe, since_s: float) -> None:
        """Find the velocity since the last view."""
        for _ in range(_ROUNDS):
            now = Keyframe(self._middle(self._unwound(view), view), 0.0)
            if not len(now.surface.points):
                return
            match = match_pair(last, now, self._moved_in(since_s), self._config, _WIDE_M)
            if match is None:
                return
            self._velocity = Tangent2(*(each / since_s for each in match.pose.log()))

    def _moved_in(self, time_s: float) -> SE2:
        """Return the motion at the velocity in a time [s]."""
        return SE2.exp(*(time_s * each for each in self._velocity))

    def _unwound(self, view: RangeScan) -> RangeScan:
        """Return a view as of its time, at the velocity."""
        return unwound_view(view, lambda at_ns: self._moved_in(1e-9 * (at_ns - view.stamp_ns)))

    def _middle(self, straight: RangeScan, view: RangeScan) -> RangeScan:
        """Return an unwound view as from where the robot was at the mean time of its beams."""
        ages_s = [
            1e-9 * (view.stamp_ns - each.stamp_ns) + 0.5 * abs(each.sweep_s) for each in view.parts
        ]
        return straight.moved(self._moved_in(float(np.mean(ages_s))))
