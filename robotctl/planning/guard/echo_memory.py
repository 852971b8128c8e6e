"""Near echoes, kept while no sonar looks there: the edge of a door that the robot has just passed.

An echo counts as a point on the axis of its sonar, once two readings have it: single ones may have
nothing to do with the world. Points are kept in the frame of the odometry until an echo from behind
shows that nothing is there any more, the robot is far away, or a while has passed. Silence clears
nothing: a smooth wall at an angle gives no echo either.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount

_NEAR_M: Final = 0.6
"""Farther echoes are left out: their place across the axis is too uncertain [m]."""
_REACH_M: Final = 1.0
"""Points farther from `base` are forgotten [m]."""
_KEPT_NS: Final = 15_000_000_000
_SAME_M: Final = 0.1
"""Echoes of two readings this near are of one thing; one so much farther shows that it is gone."""
_CELL_M: Final = 0.05
"""Points are kept once for each square of this side."""
_WITHIN_RAD: Final = math.radians(8.0)
"""A reading says nothing of what is farther from its axis than this, well within its cone."""


class EchoMemory:
    """Points around the robot from which echoes have come.

    Parameters
    ----------
    mounts
        The sonars, in the order of the ranges.
    """

    def __init__(self, mounts: Sequence[SonarMount]) -> None:
        self._mounts = [SE2(mount.x_m, mount.y_m, mount.heading_rad) for mount in mounts]
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._points = np.empty((0, 2))
        self._seen_ns = np.empty(0, np.int64)
        self._last: list[NDArray[np.float64] | None] = [None] * len(self._mounts)
        """Where the last echo of each sonar came from."""

    def take(
        self, T_odom_base: SE2, ranges_m: Sequence[float], new: Sequence[bool], now_ns: int
    ) -> None:
        """Take the readings of a step.

        Parameters
        ----------
        T_odom_base
            The robot's pose in the frame of the odometry.
        ranges_m, new
            As for `ObstacleGuard.observe`.
        now_ns
            Time of the step [ns].
        """
        came = []
        for i, mount in enumerate(self._mounts):
            if not new[i] or not math.isfinite(ranges_m[i]):
                continue
            sensor = T_odom_base @ mount
            self._clear(sensor, ranges_m[i])
            point = np.array(sensor.apply(ranges_m[i], 0.0))
            last, self._last[i] = self._last[i], point
            near = ranges_m[i] <= _NEAR_M and last is not None
            if near and math.dist(point, last) <= _SAME_M:  # type: ignore[arg-type]
                came.append(point)
        self._points = np.concatenate([np.reshape(came, (-1, 2)), self._points])
        self._seen_ns = np.concatenate([np.full(len(came), now_ns), self._seen_ns])
        away = np.hypot(*(self._points - (T_odom_base.x_m, T_odom_base.y_m)).T)
        self._keep((away <= _REACH_M) & (now_ns - self._seen_ns <= _KEPT_NS))
        _, first = np.unique(np.floor(self._points / _CELL_M), axis=0, return_index=True)
        self._keep(np.sort(first))

    def around(self, T_odom_base: SE2) -> NDArray[np.float64]:
        """Return the points in `base`, (n, 2) [m]."""
        c, s = math.cos(T_odom_base.theta_rad), math.sin(T_odom_base.theta_rad)
        away = self._points - (T_odom_base.x_m, T_odom_base.y_m)
        points: NDArray[np.float64] = away @ np.array([[c, -s], [s, c]])
        return points

    def _clear(self, sensor: SE2, range_m: float) -> None:
        """Forget points that an echo came from behind of."""
        x, y = (self._points - (sensor.x_m, sensor.y_m)).T
        off = np.arctan2(y, x) - sensor.theta_rad
        aside = np.abs(np.remainder(off + math.pi, math.tau) - math.pi)
        self._keep((aside > _WITHIN_RAD) | (np.hypot(x, y) + _SAME_M >= range_m))

    def _keep(self, which: NDArray[np.bool_] | NDArray[np.int64]) -> None:
        """Keep some of the points."""
        self._points, self._seen_ns = self._points[which], self._seen_ns[which]
