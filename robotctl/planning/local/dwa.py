"""The dynamic window approach: arcs to all velocities that the robot reaches soon.

Fox, Burgard, Thrun, "The dynamic window approach to collision avoidance", 1997. The window reaches
farther than one step, and the robot is driven ahead with its accelerations: so a turn begins in
time where the wanted rate is reached only after several steps.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.planning.local.controller import ControllerConfig
from robotctl.planning.local.follower import Choice
from robotctl.planning.local.rollout import Problem, cheapest

_WINDOW_S: Final = 0.5
"""Velocities that are reached within this time are candidates."""
_SPEEDS: Final = 0.8
"""Number of speeds over that of turns."""


class DynamicWindow:
    """Chooses the cheapest arc.

    Parameters
    ----------
    config
        Its number of samples counts.
    """

    def __init__(self, config: ControllerConfig) -> None:
        self.steps = 30
        self._speeds = round(math.sqrt(_SPEEDS * config.samples))
        self._turns = config.samples // self._speeds

    def reset(self) -> None:
        """Nothing is kept."""

    def choose(self, problem: Problem) -> Choice:
        """Return the cheapest admissible arc."""
        ahead = np.empty((self.steps, 3))
        _, v, omega = cheapest(problem, self._targets(problem), ahead)
        return Choice(v, omega, ahead)

    def _targets(self, problem: Problem) -> NDArray[np.float64]:
        """Return speeds in the section's gear with turn rates, or curvatures, (n, 1, 2)."""
        motion, gear = problem.motion, problem.gear
        reach = motion.a * _WINDOW_S
        on = gear * problem.v
        most = max(min(on + reach, problem.v_most), 0.0)
        speeds = gear * np.linspace(min(max(on - reach, 0.0), most), most, self._speeds)
        if motion.curvature_max == math.inf:
            reach = motion.alpha * _WINDOW_S
            low = max(problem.omega - reach, -motion.omega_max)
            high = min(problem.omega + reach, motion.omega_max)
            turns = np.linspace(low, high, self._turns)
            turns[np.argmin(np.abs(turns))] = 0.0
        else:
            turns = motion.curvature_max * np.linspace(-1.0, 1.0, self._turns)
        pairs = np.empty((self._speeds, self._turns, 1, 2))
        pairs[..., 0, 0] = speeds[:, np.newaxis]
        pairs[..., 0, 1] = turns
        return pairs.reshape(-1, 1, 2)
