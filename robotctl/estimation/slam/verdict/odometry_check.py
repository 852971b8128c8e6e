"""Odometry beside the scans: where the two disagree, and what is wrong with either."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from robotctl.model.geometry.se2 import SE2

_WINDOW_M: Final = 1.0
_WINDOW_RAD: Final = 0.5
"""Motions are compared over this distance or turn, whichever is complete first."""
_OFF: Final = 0.3
_OFF_RAD: Final = 0.25
"""Difference of the two above which one is wrong: as a share of the distance, and of heading [rad].

On the public logs of `docs/results/slam.md`, 3 of 2660 windows of sound odometry exceed it.
"""
_MOVED_M: Final = 0.5
_TURNED_RAD: Final = 0.2
"""Motions of this size tell how one measures the other."""
_IN_A_ROW: Final = 3
"""Number of windows that make a stretch: wheels slip now and then."""
_RECENT: Final = 2000
"""Number of windows that ratios are of, the last ones: a robot may drive for months."""
_FEW: Final = 8
"""Number of windows below which no ratio is told."""


@dataclass(frozen=True, slots=True)
class OdometryFigures:
    """Agreement of odometry and scans.

    Parameters
    ----------
    compared_m, contradicted_m
        Distance on which they are compared, and on which they disagree [m].
    longest_m
        Longest stretch of that without a break [m].
    distance_ratio, turn_ratio
        Distance and turn by odometry per distance and turn by the scans, medians; NaN: the robot
        moved too little to tell.
    yaw_rad
        Direction of the motion by the scans from that by odometry [rad]; NaN as before.
    """

    compared_m: float
    contradicted_m: float
    longest_m: float
    distance_ratio: float
    turn_ratio: float
    yaw_rad: float


@dataclass(slots=True)
class OdometryCheck:
    """Compares two trajectories of one robot over windows of a metre."""

    _last: tuple[SE2, SE2] | None = None
    _begin: tuple[SE2, SE2] | None = None
    _way: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    _rows: deque[tuple[float, ...]] = field(default_factory=lambda: deque(maxlen=_RECENT))
    _contradicted_m: float = 0.0
    _run: int = 0
    _run_m: float = 0.0
    _longest_m: float = 0.0
    _compared_m: float = 0.0

    def add(self, odometry: SE2, pose: SE2) -> None:
        """Take the next pose of `base` by odometry and by the scans, each in its own frame."""
        if self._last is None or self._begin is None:
            self.restart(odometry, pose)
            return
        steps = [
            before.inverse() @ now for before, now in zip(self._last, (odometry, pose), strict=True)
        ]
        self._last = odometry, pose
        for number, step in enumerate(steps):
            self._way[number] += math.hypot(step.x_m, step.y_m)
        self._way[2] += max(abs(step.theta_rad) for step in steps)
        if max(self._way[:2]) < _WINDOW_M and self._way[2] < _WINDOW_RAD:
            return
        self._compare(self._begin[0].inverse() @ odometry, self._begin[1].inverse() @ pose)
        self.restart(odometry, pose)

    def restart(self, odometry: SE2, pose: SE2) -> None:
        """Begin a window: after a jump of the map, or of odometry."""
        self._last = self._begin = odometry, pose
        self._way = [0.0, 0.0, 0.0]

    def _compare(self, odometry: SE2, scans: SE2) -> None:
        """Compare the motions of a window."""
        off_m = math.hypot(odometry.x_m - scans.x_m, odometry.y_m - scans.y_m)
        off_rad = abs(math.remainder(odometry.theta_rad - scans.theta_rad, 2.0 * math.pi))
        sizes = [math.hypot(each.x_m, each.y_m) for each in (odometry, scans)]
        way_m = max(self._way[:2])
        self._compared_m += way_m
        self._rows.append(
            (odometry.x_m, odometry.y_m, odometry.theta_rad, scans.x_m, scans.y_m, scans.theta_rad)
        )
        if off_m <= _OFF * max(*sizes, _MOVED_M) and off_rad <= _OFF_RAD:
            self._run, self._run_m = 0, 0.0
            return
        self._contradicted_m += way_m
        self._run += 1
        self._run_m += way_m
        if self._run >= _IN_A_ROW:
            self._longest_m = max(self._longest_m, self._run_m)

    def figures(self) -> OdometryFigures:
        """Return what is known so far."""
        rows = np.array(self._rows).reshape(-1, 6)
        by_odometry, by_scans = (
            rows[:, 0] + 1j * rows[:, 1],
            rows[:, 3] + 1j * rows[:, 4],
        )
        moved = (np.abs(by_scans) > _MOVED_M) & (np.abs(by_odometry) > 0.0)
        turned = np.abs(rows[:, 5]) > _TURNED_RAD
        distance = turn = yaw = math.nan
        if moved.sum() >= _FEW:
            distance = float(np.median(np.abs(by_odometry[moved]) / np.abs(by_scans[moved])))
            yaw = float(np.angle(np.sum(by_scans[moved] * by_odometry[moved].conj())))
        if turned.sum() >= _FEW:
            turn = float(np.median(rows[turned, 2] / rows[turned, 5]))
        return OdometryFigures(
            self._compared_m, self._contradicted_m, self._longest_m, distance, turn, yaw
        )
