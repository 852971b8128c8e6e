"""One rung of the ladder of recoveries under way."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.behaviour import BehaviourOutput
from robotctl.planning.behave.behaviours.recovery import Rung
from robotctl.planning.behave.journey.tools import JourneyTools

BEHIND_M: Final = (0.05, 0.1, 0.2)
"""Distances behind the robot at which the floor has to be known for it to drive backwards [m]."""
TURNS_RAD: Final = (0.1, 0.2, 0.4)
"""Turns that have to be free for it to begin [rad]."""


class Attempt:
    """One rung.

    Parameters
    ----------
    rung
        What it does.
    reason
        The trouble, for people.
    now_ns, pose
        When and where it begins.
    """

    def __init__(self, rung: Rung, reason: str, now_ns: int, pose: SE2) -> None:
        self.rung = rung
        self.text = f"{rung.value}: {reason}"
        self._begin_ns = now_ns
        self._begin = pose.x_m, pose.y_m
        self._last_rad = pose.theta_rad
        self._turned_rad = 0.0

    def step(self, tools: JourneyTools, pose: SE2, now_ns: int) -> BehaviourOutput | None:
        """Return the next velocity; None once it has ended."""
        spent_ns, rungs = now_ns - self._begin_ns, tools.journey.rungs
        v, omega = 0.0, 0.0
        if self.rung is Rung.WAIT:
            goes_on = spent_ns < round(1e9 * rungs.wait_s)
        elif self.rung is Rung.BACK_OFF:
            v = -rungs.back_m_s
            behind = poses_after(pose, [SE2(-x_m, 0.0, 0.0) for x_m in BEHIND_M])
            goes_on = math.dist((pose.x_m, pose.y_m), self._begin) < tools.recovery.back_off_m
            goes_on &= tools.world.map.is_known(behind) and not tools.world.touches(behind)
        elif self.rung is Rung.LOOK_AROUND:
            omega = rungs.turn_rad_s
            self._turned_rad += abs(wrap_angle(pose.theta_rad - self._last_rad))
            self._last_rad = pose.theta_rad
            turned = poses_after(pose, [SE2(0.0, 0.0, turn_rad) for turn_rad in TURNS_RAD])
            goes_on = self._turned_rad < math.tau and not tools.world.touches(turned)
        else:
            goes_on = spent_ns < round(1e9 * rungs.pause_s)
        if not goes_on or spent_ns > round(1e9 * rungs.longest_s):
            return None
        return BehaviourOutput(v, omega, text=self.text)


def poses_after(pose: SE2, motions: list[SE2]) -> NDArray[np.float64]:
    """Return where each motion leads to, (n, 3)."""
    ends = [pose @ motion for motion in motions]
    return np.array([(end.x_m, end.y_m, end.theta_rad) for end in ends])
