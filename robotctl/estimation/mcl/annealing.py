"""Annealed weighing: a sharp likelihood applied in steps, for a belief that is spread wide.

A sequential Monte Carlo sampler (Del Moral, Doucet, Jasra 2006): the likelihood is raised to a
power that grows from 0 to 1. Each step raises it as far as the particles allow, resamples them and
lets each try a random place nearby, accepted by the Metropolis rule. So thousands of particles find
a peak that is a thousand times smaller than their spacing. The belief before the measurement counts
as flat over the length of a trial, which holds while the robot is searched for.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.mcl.particles import effective_size, posterior, resample_systematic
from robotctl.estimation.mcl.pose_bins import BinSize
from robotctl.estimation.mcl.sliced import Sliced, evaluated_in_slices
from robotctl.estimation.mcl.tempering import bearable_exponent
from robotctl.estimation.ranging.log_likelihood import LogLikelihood

_STEPS = 10
"""Steps of one measurement: if the exponent is not 1 by then it is kept, and the next continues."""
_TRIALS = 2
"""Trials of each particle in each step: they make copies of one particle differ again."""
_FINEST = 0.2
"""Trials go as far as a bin, and down to this share of it."""


def anneal(
    poses: NDArray[np.float64],
    weights: NDArray[np.float64],
    logs: NDArray[np.float64],
    log_likelihood: LogLikelihood,
    count: int,
    trials: BinSize,
    n_eff_floor: float,
    rng: np.random.Generator,
    measurements: int = 1,
) -> Sliced[tuple[NDArray[np.float64], NDArray[np.float64]] | None]:
    """Return poses and weights after a measurement, from those before it.

    None if the measurement is impossible at all poses.

    Parameters
    ----------
    poses, weights, logs
        The belief, (n, 3) [m, m, rad] and (n,) of sum 1, and the measurement's log-likelihoods,
        (n,).
    log_likelihood
        The measurement.
    count
        Particles that go on from the first step, >= 1.
    trials
        Standard deviation of the widest trials.
    n_eff_floor
        Share of the effective particles that stay so in each step, (0, 1).
    rng
        Draws trials and their fate.
    measurements
        Number of measurements that the log-likelihood is the sum of.
    """
    if logs.max() == -math.inf:
        return None
    reached = 0.0
    for _ in range(_STEPS):
        # Apply only as much of the measurement as keeps enough particles alive.
        least = n_eff_floor * min(effective_size(weights), count)
        exponent = min(bearable_exponent(weights, logs, least), 1.0 - reached)
        weights, _ = posterior(weights, exponent * logs)
        reached += exponent
        if reached >= 1.0:
            break
        chosen = resample_systematic(weights, count, rng)
        poses, logs, weights = poses.take(chosen, axis=0), logs[chosen], np.full(count, 1.0 / count)
        for _ in range(_TRIALS):
            others = _moved(poses, trials, rng)
            their_logs = yield from evaluated_in_slices(log_likelihood, others, measurements)
            # Metropolis rule; log1p(-u) of a uniform u in [0, 1) is never log(0).
            better = np.log1p(-rng.random(count)) < reached * (their_logs - logs)
            poses = np.where(better[:, np.newaxis], others, poses)
            logs = np.where(better, their_logs, logs)
    return poses, weights


def _moved(
    poses: NDArray[np.float64], trials: BinSize, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return a place to try near each pose, (n, 3)."""
    n = len(poses)
    off = rng.standard_normal((n, 3))
    off *= (trials.side_m, trials.side_m, math.tau / trials.headings)
    # Trial sizes from a whole bin down to a fraction: coarse ones explore, fine ones polish.
    off *= _FINEST ** rng.random((n, 1))
    others = poses + off
    others[:, 2] -= math.tau * np.round(others[:, 2] / math.tau)
    return others
