"""The best of many random poses: how a search covers a campus with the particles of a flat.

The peak of a scan's likelihood is some 0.2 m and 2 degrees wide: of fifty random poses on each
square metre one lies in it by luck only. So where a sensor can say how well the surroundings of a
pose may fit (`Coarse`), poses are first weighed by that, the best are replaced by eight in their
surroundings, which are narrower, and so on: as branch and bound does (Hess et al. 2016), but
with a fixed number of survivors, so that the time is known. Of other sensors the poses themselves
are weighed, and those of a flat. Poses that fit nothing, nearly all, are forgotten batch by batch.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.mcl.free_space import SampleFree
from robotctl.estimation.mcl.sliced import SLICE, Sliced
from robotctl.estimation.ranging.log_likelihood import (
    COARSE_SHARE,
    Coarse,
    LogLikelihood,
    evaluated,
)

_SIDE_M: Final = 1.2
_TURN_RAD: Final = math.tau / 60
"""Surroundings of a random pose: a square [m] and as many headings [rad]."""
_SURVIVORS: Final = (14, 28, 50, 70)
"""The share of the random poses that survives each step, one in so many."""
_AFFORDED: Final = 50_000
"""Number of random poses up to which they are weighed themselves: those of 1000 m2."""
_FEWEST: Final = 2000
"""Poses that survive at least."""
_CORNERS: Final = np.array([[x, y, t] for x in (-1, 1) for y in (-1, 1) for t in (-1, 1)])
_NARROWER: Final = 0.6
"""Width of the next surroundings, as a share; a half would be a tiling without overlap."""

Weighed = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Poses, (n, 3) [m, m, rad], and their log-likelihoods, (n,)."""


def best_anywhere(
    sample_free: SampleFree,
    rng: np.random.Generator,
    log_likelihood: LogLikelihood,
    poses: int,
    keep: int,
) -> Sliced[Weighed]:
    """Return the best places that random poses lead to, at most `keep`, and their log-likelihoods.

    Parameters
    ----------
    sample_free, rng
        Draw poses.
    log_likelihood
        The measurement.
    poses
        Random poses to begin with, >= 1.
    keep
        Poses wanted, >= 1.
    """
    batches = _drawn(sample_free, rng, poses)
    if isinstance(log_likelihood, Coarse) and poses > _AFFORDED:
        side_m, turn_rad = _SIDE_M, _TURN_RAD
        for survivors in _SURVIVORS:
            coarse = log_likelihood.coarse(side_m, turn_rad)
            best, _ = yield from _best_of(
                batches, max(poses // survivors, _FEWEST), coarse, COARSE_SHARE
            )
            batches = _around(best, side_m, turn_rad)
            side_m, turn_rad = _NARROWER * side_m, _NARROWER * turn_rad
    return (yield from _best_of(batches, keep, log_likelihood))


def _drawn(
    sample_free: SampleFree, rng: np.random.Generator, count: int
) -> Iterator[NDArray[np.float64]]:
    """Yield so many random poses in batches, (n, 3) each."""
    for begin in range(0, count, SLICE):
        yield sample_free(rng, min(SLICE, count - begin))


def _around(
    poses: NDArray[np.float64], side_m: float, turn_rad: float
) -> Iterator[NDArray[np.float64]]:
    """Yield eight poses in the surroundings of each pose, in batches, (n, 3) each."""
    offs = 0.5 * _NARROWER * _CORNERS * (side_m, side_m, turn_rad)
    size = SLICE // len(offs)
    for begin in range(0, len(poses), size):
        yield (poses[begin : begin + size, None] + offs).reshape(-1, 3)


def _best_of(
    batches: Iterator[NDArray[np.float64]],
    keep: int,
    log_likelihood: LogLikelihood,
    cost: float = 1.0,
) -> Sliced[Weighed]:
    """Return the best poses of all batches; one takes `cost` times as long as usual."""
    least = -math.inf
    poses: list[NDArray[np.float64]] = []
    logs: list[NDArray[np.float64]] = []
    held = 0
    for batch in batches:
        its = evaluated(log_likelihood, batch)
        yield math.ceil(cost * len(batch))
        good = its >= least
        poses.append(batch[good])
        logs.append(its[good])
        held += len(logs[-1])
        if held > 2 * keep:
            best = _best(poses, logs, keep)
            poses, logs, held, least = [best[0]], [best[1]], keep, float(best[1].min())
    return _best(poses, logs, keep)


def _best(poses: list[NDArray[np.float64]], logs: list[NDArray[np.float64]], keep: int) -> Weighed:
    """Return the best of these, in the order in which they came."""
    all_poses, all_logs = np.concatenate(poses), np.concatenate(logs)
    if len(all_logs) > keep:
        best = np.sort(np.argpartition(-all_logs, keep - 1)[:keep])
        all_poses, all_logs = all_poses[best], all_logs[best]
    all_poses[:, 2] -= math.tau * np.round(all_poses[:, 2] / math.tau)
    return all_poses, all_logs
