"""Model predictive path integral control: many random variations of a plan, averaged by cost.

Williams, Drews, Goldfain, Rehg, Theodorou, "Information theoretic MPC for model-based reinforcement
learning", 2017, algorithm 2, with noise that changes slowly and without its control cost. The
average of good plans to the left and right of something may lead into it: the cheapest sample is
taken where it costs less than the average. The samples are drawn once, and mirrored by turns.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.planning.path.local.controller import ControllerConfig, tried
from robotctl.planning.path.local.follower import Choice
from robotctl.planning.path.local.rollout import (
    RolloutProblem,
    braked,
    first_velocity,
    is_admissible,
    price,
)

_KNOTS: Final = 6
"""Random values of a sample, between which it changes linearly."""
_TRIES: Final = 40
"""Samples whose first velocity is looked at: all are seldom inadmissible."""
_MIRRORS: Final = ((1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0))
"""Signs of the noise from step to step, so that its mean is 0."""


class PathIntegral:
    """Keeps a plan of wanted velocities and improves it at each step.

    Parameters
    ----------
    config
        Its numbers of samples and seed count.
    """

    def __init__(self, config: ControllerConfig) -> None:
        self.steps = 50
        self._dt_s, self._tau_s = config.dt_s, config.tau_s
        self._spread, self._temperature = config.spread, float(config.temperature)
        rng = np.random.default_rng(config.seed)
        knots = rng.standard_normal((config.samples, _KNOTS, 2))
        across = rng.standard_normal((config.samples, _KNOTS, 1))
        knots = np.concatenate([knots, across], axis=2)
        at = np.linspace(0.0, _KNOTS - 1.0, self.steps)
        before = np.minimum(at.astype(np.int64), _KNOTS - 2)
        share = (at - before)[:, np.newaxis]
        self._noise = (1.0 - share) * knots[:, before] + share * knots[:, before + 1]
        self._noise[0] = 0.0  # the plan as it is
        self.reset()

    def reset(self) -> None:
        """Forget the plan."""
        self._plan = np.zeros((self.steps, 3))
        self._count = 0

    def choose(self, problem: RolloutProblem, effort: float) -> Choice:
        """Return the plan's first velocity, or that of another sample, whichever is admissible."""
        motion = problem.motion
        step_s = self._tau_s / self.steps
        now = np.arange(self.steps) + self._dt_s / step_s
        self._plan = np.stack(
            [np.interp(now, np.arange(self.steps), self._plan[:, i]) for i in range(3)], axis=1
        )
        turn_max = min(motion.curvature_max, motion.omega_max)
        if motion.curvature_max != np.inf:
            turn_max = motion.curvature_max
        mirror = _MIRRORS[self._count % len(_MIRRORS)]
        spread = (
            self._spread * motion.v_max * mirror[0],
            self._spread * turn_max * mirror[1],
            self._spread * motion.vy_max * mirror[1],
        )
        self._count += 1
        ahead = np.empty((self.steps, 3))
        noise = self._noise[: tried(len(self._noise), effort)]
        v, omega, vy = _improve(
            problem, self._plan, noise, spread, turn_max, self._temperature, ahead
        )
        return Choice(v, omega, ahead, vy)


@compiled
def _vary(
    problem: RolloutProblem,
    plan: NDArray[np.float64],
    noise: NDArray[np.float64],
    spread: tuple[float, float, float],
    turn_max: float,
    varied: NDArray[np.float64],
) -> None:
    """Write a plan with noise to `varied`, within the robot's limits and the section's gear."""
    low, high = (0.0, problem.v_most) if problem.gear > 0.0 else (-problem.v_most, 0.0)
    for i in range(len(plan)):
        varied[i, 0] = min(max(plan[i, 0] + spread[0] * noise[i, 0], low), high)
        varied[i, 1] = min(max(plan[i, 1] + spread[1] * noise[i, 1], -turn_max), turn_max)
    most = problem.motion.vy_max
    if most > 0.0:
        for i in range(len(plan)):
            varied[i, 2] = min(max(plan[i, 2] + spread[2] * noise[i, 2], -most), most)


@compiled
def _improve(
    problem: RolloutProblem,
    plan: NDArray[np.float64],
    noise: NDArray[np.float64],
    spread: tuple[float, float, float],
    turn_max: float,
    temperature: float,
    drawn: NDArray[np.float64],
) -> tuple[float, float, float]:
    """Replace the plan by a better one; return the first velocity."""
    motion, v_most, now = problem.motion, problem.v_most, (problem.v, problem.omega, problem.vy)
    costs = np.empty(len(noise))
    varied, mean = np.zeros_like(plan), np.zeros_like(plan)
    nothing = np.empty((0, 3))
    for i in range(len(noise)):
        _vary(problem, plan, noise[i], spread, turn_max, varied)
        costs[i] = price(problem, varied, nothing)
    least, total = costs.min(), 0.0
    for i in range(len(noise)):
        weight = np.exp((least - costs[i]) / temperature)
        if weight > 1e-6:
            _vary(problem, plan, noise[i], spread, turn_max, varied)
            mean += weight * varied
            total += weight
    mean /= total
    if price(problem, mean, drawn) <= least:
        v, omega, vy = first_velocity(motion, v_most, now, (mean[0, 0], mean[0, 1], mean[0, 2]))
        if is_admissible(problem, v, omega, vy):
            plan[:] = mean
            return v, omega, vy
    for _ in range(_TRIES):
        best = int(np.argmin(costs))
        _vary(problem, plan, noise[best], spread, turn_max, varied)
        target = varied[0, 0], varied[0, 1], varied[0, 2]
        v, omega, vy = first_velocity(motion, v_most, now, target)
        if is_admissible(problem, v, omega, vy):
            plan[:] = varied
            price(problem, plan, drawn)
            return v, omega, vy
        costs[best] = np.inf
    plan[:] = 0.0
    price(problem, plan, drawn)
    return braked(problem)
