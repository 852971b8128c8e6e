"""Score of a drive by SLAM: its trajectory against the true one, and the loops it closed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from robotctl.app.scoring.score import SlamReport, StampedPose
from robotctl.messages.estimation import ClosedLoop
from robotctl.model.geometry.points import align, moved
from robotctl.model.geometry.se2 import SE2
from robotctl.model.trajectory import Trajectory

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
        self._loops: list[ClosedLoop] = []
        self._verdict = ""

    def truth(self, pose: StampedPose) -> None:
        """Take a true pose; they come in the order of their stamps."""
        if not self._stamps_ns or pose.stamp_ns >= self._stamps_ns[-1] + _EVERY_NS:
            self._stamps_ns.append(pose.stamp_ns)
            self._truths.append(pose.pose)

    def estimate(self, believed: SE2, true: SE2) -> None:
        """Take a pose as it was believed, and the true one of its time."""
        self._believed.append(believed)
        self._true.append(true)

    def hear(self, loops: Sequence[ClosedLoop], verdict: str) -> None:
        """Take loops that were closed, and the localiser's word on its map."""
        self._loops += loops
        self._verdict = verdict

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
        truth = Trajectory.of(self._stamps_ns, self._truths)
        judged = [_is_right(each, truth) for each in self._loops]
        return SlamReport(
            ape_m=float(np.sqrt(np.mean(np.sum(off**2, axis=1)))),
            rpe_m=float(rpe[0]),
            rpe_rad=float(rpe[1]),
            loops=len(judged) - judged.count(None),
            false_loops=judged.count(False),
            verdict=self._verdict,
        )

    def _relative(self, begin: int, end: int) -> tuple[float, float]:
        """Return the squared errors of the motion between two estimates [m^2, rad^2]."""
        believed = self._believed[begin].inverse() @ self._believed[end]
        off = (self._true[begin].inverse() @ self._true[end]).inverse() @ believed
        return off.x_m**2 + off.y_m**2, off.theta_rad**2


def _is_right(loop: ClosedLoop, truth: Trajectory) -> bool | None:
    """Return whether a loop is true; None: it is of a time whose truth is not known."""
    later, earlier = truth.at(loop.stamp_ns), truth.at(loop.earlier_ns)
    if later is None or earlier is None:
        return None
    found = SE2(loop.x_m, loop.y_m, loop.theta_rad)
    off = (earlier.inverse() @ later).inverse() @ found
    return math.hypot(off.x_m, off.y_m) <= _FALSE_M and abs(off.theta_rad) <= _FALSE_RAD
