"""Walkers who follow a path at a steady speed, whoever is in the way."""

from __future__ import annotations

import numpy as np

from firmware_sim.world.walking.path import ClosedPath
from firmware_sim.world.walking.walker import STEP_NS, STEP_S, Place, Walker


class Stubborn(Walker):
    """A closed path, and the distance walked along it.

    Parameters
    ----------
    corners
        Corners of the path, the first again at the end, (k, 2) [m].
    speed_m_s
        Speed [m/s].
    stands_s
        Time for which it stands at the last corner each time it comes there [s].
    """

    __slots__ = ("_left_steps", "_path", "_stands_steps", "at_m", "sign", "speed_m_s")

    def __init__(self, corners: np.ndarray, speed_m_s: float, stands_s: float = 0.0) -> None:
        self._path = ClosedPath(corners)
        self._stands_steps = round(stands_s / STEP_S)
        self._left_steps = 0
        """Remaining steps for which it stands."""
        self.speed_m_s = speed_m_s
        self.at_m = 0.0
        self.sign = 1.0
        super().__init__(self._path.along(0.0))

    @property
    def _next_m(self) -> float:
        """Distance along the path after the next step [m]."""
        return self.at_m + self.sign * self.speed_m_s * STEP_NS * 1e-9

    def ahead(self) -> Place:
        """Return the place a step farther along the path, or the present one while it stands."""
        return self.place if self._left_steps else self._path.along(self._next_m)

    def go(self, ahead: Place) -> None:
        """Walk on along the path, or stand."""
        if self._left_steps:
            self._left_steps -= 1
            return
        if self._path.passes_last(self.at_m, self._next_m):
            self._left_steps = self._stands_steps
        self.at_m, self.place = self._next_m, ahead

    def turn_round(self) -> None:
        """Walk the path the other way."""
        self.sign = -self.sign
