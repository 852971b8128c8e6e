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

from robotctl.planning.path.local.controller import ControllerConfig, tried
from robotctl.planning.path.local.follower import Choice
from robotctl.planning.path.local.rollout import RolloutProblem, cheapest

_SPEEDS: Final = 0.8
"""Number of speeds over that of turns."""
_SIDES: Final = 5
"""Number of speeds sideways of a holonomic robot."""


class DynamicWindow:
    """Chooses the cheapest arc.

    Parameters
    ----------
    config
        Its number of samples counts.
    """

    def __init__(self, config: ControllerConfig) -> None:
        self.steps = 30
        self._samples, self._window_s = config.samples, config.window_s

    def reset(self) -> None:
        """Nothing is kept."""

    def choose(self, problem: RolloutProblem, effort: float) -> Choice:
        """Return the cheapest admissible arc."""
        ahead = np.empty((self.steps, 3))
        targets = self._targets(problem, tried(self._samples, effort))
        _, v, omega, vy = cheapest(problem, targets, ahead)
        return Choice(v, omega, ahead, vy)

    def _targets(self, problem: RolloutProblem, samples: int) -> NDArray[np.float64]:
        """Return speeds in the section's gear, turn rates or curvatures, and slides, (n, 1, 3)."""
        motion, gear = problem.motion, problem.gear
        sides = _SIDES if motion.vy_max > 0.0 else 1
        fore = round(math.sqrt(_SPEEDS * samples / sides))
        round_ = samples // sides // fore
        reach = motion.a * self._window_s
        on = gear * problem.v
        most = max(min(on + reach, problem.v_most), 0.0)
        speeds = gear * np.linspace(min(max(on - reach, 0.0), most), most, fore)
        if motion.curvature_max == math.inf:
            turns = _window(problem.omega, motion.alpha * self._window_s, motion.omega_max, round_)
        else:
            turns = motion.curvature_max * np.linspace(-1.0, 1.0, round_)
        slides = np.zeros(1)
        if motion.vy_max > 0.0:
            slides = _window(problem.vy, motion.a * self._window_s, motion.vy_max, sides)
        targets = np.empty((fore, round_, sides, 1, 3))
        targets[..., 0, 0] = speeds[:, np.newaxis, np.newaxis]
        targets[..., 0, 1] = turns[:, np.newaxis]
        targets[..., 0, 2] = slides
        return targets.reshape(-1, 1, 3)


def _window(now: float, reach: float, most: float, count: int) -> NDArray[np.float64]:
    """Return values within reach of the present one, 0 or what is nearest to it among them."""
    values = np.linspace(max(now - reach, -most), min(now + reach, most), count)
    values[np.argmin(np.abs(values))] = 0.0
    return values
