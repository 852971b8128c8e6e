"""A planned path with the robot's place on it."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.se2 import SE2
from robotctl.planning.path.global_planning.plan import Plan, dense

_STEP_M: Final = 0.05
"""Spacing of the places that are checked [m]."""
_AHEAD_M: Final = 2.0
"""Along the path, in which the nearest place is looked for [m]."""


class Route:
    """Keeps how far along its path a robot is.

    Parameters
    ----------
    plan
        The path.
    leads_there
        Whether it ends at the goal; else on the way there.
    until
        Where it leads if there is something else to do at its end, for people: "" or " to ...".
    """

    def __init__(self, plan: Plan, *, leads_there: bool = True, until: str = "") -> None:
        self.plan = plan
        self.leads_there = leads_there
        self.until = until
        self._places = dense(plan.poses, _STEP_M)
        steps = np.hypot(*np.diff(self._places[:, :2], axis=0).T)
        self._along_m = np.concatenate([[0.0], np.cumsum(steps)])
        self._at = 0

    def advance(self, pose: SE2) -> float:
        """Move on to the place nearest to the robot; return its distance from there [m]."""
        last = int(np.searchsorted(self._along_m, self._along_m[self._at] + _AHEAD_M))
        ahead = self._places[self._at : last + 1, :2] - (pose.x_m, pose.y_m)
        away_m = np.hypot(*ahead.T)
        nearest = int(np.argmin(away_m))
        self._at += nearest
        return float(away_m[nearest])

    @property
    def left_m(self) -> float:
        """Length of the rest of the path [m]."""
        return float(self._along_m[-1] - self._along_m[self._at])

    @property
    def rest(self) -> NDArray[np.float64]:
        """The rest of its places, (n, 3), no farther apart than a body's outline can miss."""
        return self._places[self._at :]
