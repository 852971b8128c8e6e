"""Score of a drive by SLAM: its trajectory against the true one, and the loops it closed."""

from __future__ import annotations

import math
from bisect import bisect_right
from typing import Final

import numpy as np

from robotctl.app.simulation.score import SlamReport, StampedPose
from robotctl.messages.estimation import ClosedLoop
from robotctl.model.drives.motion import between
from robotctl.model.geometry.points import align, moved
from robotctl.model.geometry.se2 import SE2

_STEP_M: Final = 1.0
"""Way of which errors are relative."""
_FALSE_M: Final = 0.5
_FALSE_RAD: Final = 0.2
"""A loop whose two ends are farther off than this is false."""
_EVERY_NS: Final = 20_000_000
"""True poses are kept so far apart in time."""


class SlamScore:
    """Collects where the robot believed to be, where it was, and which loops it closed."""

    def __init__(self) -> None:
        self._believed: list[SE2] = []
        self._true: list[SE2] = []
        self._stamps_ns: list[int] = []
        self._truths: list[SE2] = []
        self._loops = self._false = 0
        self._waiting: list[ClosedLoop] = []

    def truth(self, pose: StampedPose) -> None:
        """Take a true pose; they come in the order of their stamps."""
        if not self._stamps_ns or pose.stamp_ns >= self._stamps_ns[-1] + _EVERY_NS:
            self._stamps_ns.append(pose.stamp_ns)
            self._truths.append(pose.pose)
        # The truth may come later than what is said of it.
        waiting, self._waiting = self._waiting, []
        for each in waiting:
            self.loop(each)

    def estimate(self, believed: SE2, true: SE2) -> None:
        """Take a pose as it was believed, and the true one of its time."""
        self._believed.append(believed)
        self._true.append(true)

    def loop(self, loop: ClosedLoop) -> None:
        """Take a loop."""
        later, earlier = self._at(loop.stamp_ns), self._at(loop.earlier_ns)
        if later is None:
            self._waiting.append(loop)
        elif earlier is not None:
            found = SE2(loop.x_m, loop.y_m, loop.theta_rad)
            off = (earlier.inverse() @ later).inverse() @ found
            is_false = math.hypot(off.x_m, off.y_m) > _FALSE_M or abs(off.theta_rad) > _FALSE_RAD
            self._loops += 1
            self._false += is_false

    def _at(self, stamp_ns: int) -> SE2 | None:
        """Return the true pose of a time; None before the first and after the last."""
        row = bisect_right(self._stamps_ns, stamp_ns)
        if row == 0 or (row == len(self._stamps_ns) and stamp_ns > self._stamps_ns[-1]):
            return None
        if row == len(self._stamps_ns):
            return self._truths[-1]
        begin_ns, end_ns = self._stamps_ns[row - 1 : row + 1]
        share = (stamp_ns - begin_ns) / (end_ns - begin_ns)
        return between(self._truths[row - 1], self._truths[row], share)

    def result(self) -> SlamReport | None:
        """Return the score so far; None before there are two estimates."""
        if len(self._true) < 2:
            return None
        believed = np.array([(each.x_m, each.y_m) for each in self._believed])
        true = np.array([(each.x_m, each.y_m) for each in self._true])
        off = moved(align(believed, true), believed) - true
        way_m = np.append(0.0, np.cumsum(np.hypot(*np.diff(true, axis=0).T)))
        ends = np.searchsorted(way_m, way_m + _STEP_M)
        rows = np.flatnonzero(ends < len(way_m))
        squares = [self._relative(row, int(ends[row])) for row in rows.tolist()]
        rpe = np.sqrt(np.mean(squares, axis=0)) if squares else (math.nan, math.nan)
        return SlamReport(
            ape_m=float(np.sqrt(np.mean(np.sum(off**2, axis=1)))),
            rpe_m=float(rpe[0]),
            rpe_rad=float(rpe[1]),
            loops=self._loops,
            false_loops=self._false,
        )

    def _relative(self, begin: int, end: int) -> tuple[float, float]:
        """Return the squared errors of the motion between two estimates [m^2, rad^2]."""
        believed = self._believed[begin].inverse() @ self._believed[end]
        off = (self._true[begin].inverse() @ self._true[end]).inverse() @ believed
        return off.x_m**2 + off.y_m**2, off.theta_rad**2
