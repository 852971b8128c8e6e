"""The way that a journey has driven."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from robotctl.model.geometry.se2 import SE2

_SPACING_M: Final = 0.1
_MOST: Final = 200
"""Poses that are kept, this far apart [m]."""
_BENT_RAD: Final = 0.5
"""Turn between two of them that no robot drives on the way back."""


class Progress:
    """Measures the way driven, and keeps the last part of it that was driven ahead."""

    def __init__(self) -> None:
        self.pause()

    def pause(self) -> None:
        """Note that the robot may be elsewhere at the next pose."""
        self.driven_m = 0.0
        self._last: SE2 | None = None
        self._track: deque[SE2] = deque(maxlen=_MOST)

    @property
    def track(self) -> list[SE2]:
        """Poses that the robot has driven ahead through, the last one first."""
        return list(self._track)

    def follow(self, pose: SE2) -> None:
        """Count the way to a pose of `base` in `world`."""
        if self._last is not None:
            self.driven_m += math.dist((pose.x_m, pose.y_m), (self._last.x_m, self._last.y_m))
        self.stand(pose)
        if not self._track:
            self._track.appendleft(pose)
            return
        step = self._track[0].inverse() @ pose
        if math.hypot(step.x_m, step.y_m) < _SPACING_M and abs(step.theta_rad) < _BENT_RAD:
            return
        if step.x_m < abs(step.y_m) or abs(step.theta_rad) >= _BENT_RAD:
            self._track.clear()  # backwards, sideways or on the spot
        self._track.appendleft(pose)

    def stand(self, pose: SE2) -> None:
        """Take a pose without counting the way to it."""
        self._last = pose
