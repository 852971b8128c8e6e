"""Points of a lidar near the robot, kept while it does not see there.

A lidar at the front of a robot sees little of what is beside its tail, and a robot that moves
sideways drives there. So the points about the robot are kept in the frame of the odometry until the
lidar sees that place again.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.footprint import Footprint
from robotctl.model.footprint_arrays import covers, side_rows
from robotctl.model.geometry.points import moved
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.planning.guard_config import GuardMemoryConfig

_BEAMS: Final = 1.5
"""Spacings of the beams within which both beams beside a point look at it."""
_CELL_M: Final = 0.02
"""Side of a square for which one point is kept [m]: finer than the guard's margin."""


class ScanMemory:
    """Points near the robot, seen before and not in view now.

    Parameters
    ----------
    body
        The robot.
    config
        See there.
    """

    def __init__(
        self,
        body: Footprint,
        config: GuardMemoryConfig = GuardMemoryConfig(),  # noqa: B008
    ) -> None:
        self._config = config
        self._life_ns = round(1e9 * config.life_s)
        self.use_body(body)
        self.reset()

    def use_body(self, body: Footprint) -> None:
        """Remember round another body from now on."""
        self._body = side_rows(body)

    def reset(self) -> None:
        """Forget everything."""
        self._points = np.empty((0, 2))
        """(n, 2) in the frame of the odometry [m]."""
        self._seen_ns = np.empty(0, np.int64)

    def see(self, T_odom_base: SE2, scan: RangeScan, now_ns: int) -> None:
        """Take a scan, taken at a pose in the frame of the odometry.

        Parameters
        ----------
        T_odom_base
            The robot at the time of the scan.
        scan
            Its beams in `base`.
        now_ns
            Time of the step [ns].
        """
        base = moved(T_odom_base.inverse(), self._points)
        kept_m, same_m = self._config.scan_kept_m, self._config.scan_same_m
        kept = (np.hypot(*base.T) < kept_m) & (now_ns - self._seen_ns < self._life_ns)
        kept &= ~covers(self._body, base) & ~_in_view(base, scan, same_m)
        new = scan.points_base()
        new = moved(T_odom_base, new[np.hypot(*new.T) < kept_m])
        points = np.concatenate([new, self._points[kept]])
        stamps_ns = np.append(np.full(len(new), now_ns), self._seen_ns[kept])
        _, first = np.unique(np.floor(points / _CELL_M).astype(np.int64), axis=0, return_index=True)
        self._points, self._seen_ns = points[first], stamps_ns[first]

    def around(self, T_base_odom: SE2, now_ns: int) -> NDArray[np.float64]:
        """Return the points near the robot in `base`, (n, 2) [m]."""
        base = moved(T_base_odom, self._points[now_ns - self._seen_ns < self._life_ns])
        within = np.hypot(*base.T) < self._config.scan_reach_m
        near: NDArray[np.float64] = base[within & ~covers(self._body, base)]
        return near


def _in_view(points: NDArray[np.float64], scan: RangeScan, same_m: float) -> NDArray[np.bool_]:
    """Return which points in `base` a scan would show if something were there, (n,).

    The beams on both sides have to see beyond the point: what is leaving the view, and the edge of
    what is still seen, lie beside one beam only. A beam that ends `same_m` nearer does not see it.
    """
    if len(scan.angles_rad) < 2 or not len(points):
        return np.zeros(len(points), np.bool_)
    x, y = (points - (scan.x_m, scan.y_m)).T
    directions = np.mod(scan.angles_rad, math.tau)
    order = np.argsort(directions)
    directions, ranges_m = directions[order], scan.ranges_m[order]
    bearings = np.mod(np.arctan2(y, x), math.tau)
    after = np.searchsorted(directions, bearings)
    beside = np.stack([after - 1, after]) % len(directions)
    off = np.abs(np.mod(bearings - directions[beside] + math.pi, math.tau) - math.pi)
    looks: NDArray[np.bool_] = off.max(axis=0) <= _BEAMS * np.median(np.diff(directions))
    # nan: no reading, it saw nothing
    looks &= (ranges_m[beside] > np.hypot(x, y) - same_m).all(axis=0)
    return looks
