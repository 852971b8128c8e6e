"""Other places that explain what a robot has seen nearly as well as the one where a search ended.

Where a map resembles itself, a search may end in the wrong one of two places: the few particles of
the right one were drawn away while a scan fitted both. So before such a place is accepted, the map
is searched again, without it: many random poses are weighed by the last measurement, the best of
them, and those that the map's symmetries name, by all that are remembered, and these are led to the
peaks of that sum (`annealing.py`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.mcl.annealing import anneal
from robotctl.estimation.mcl.belief import Cluster
from robotctl.estimation.mcl.coarse_to_fine import best_anywhere
from robotctl.estimation.mcl.config import MclConfig
from robotctl.estimation.mcl.free_space import SampleFree
from robotctl.estimation.mcl.particle_belief import ParticleBelief
from robotctl.estimation.mcl.particles import resample_systematic
from robotctl.estimation.mcl.remembered import Remembered
from robotctl.estimation.mcl.sliced import Sliced, evaluated_in_slices
from robotctl.estimation.mcl.tuning import SearchConfig
from robotctl.model.geometry.se2 import SE2

_WEIGHED_BY_ALL: Final = 2000
"""Poses, the best by the last measurement, that are weighed by all."""
_LED: Final = 1000
"""Poses that are led to the peaks."""
_OF_BELIEF: Final = 200
"""Particles of the belief that are led to its own peak, for comparison."""


def look_alikes(
    belief: ParticleBelief,
    remembered: Remembered,
    sample_free: SampleFree,
    config: MclConfig,
    rng: np.random.Generator,
    symmetries: Sequence[SE2] = (),
) -> Sliced[NDArray[np.float64] | None]:
    """Return poses (n, 3) of other places; None if there are none.

    Parameters
    ----------
    belief
        The belief in which the search ended.
    remembered
        Its measurements.
    sample_free, config, rng
        The same as those of the localiser.
    symmetries
        Motions that carry the map nearly onto itself.
    """
    held = belief.poses.take(resample_systematic(belief.weights, _OF_BELIEF, rng), axis=0)
    images = [_image(held, motion) for motion in symmetries]
    best, _ = yield from best_anywhere(
        sample_free, rng, remembered.newest, config.poses_of_search, _WEIGHED_BY_ALL
    )
    others = np.concatenate([best, *images])
    others = others[are_apart(others, belief.best, config.search)]
    if len(others) == 0:
        return None
    fits = yield from evaluated_in_slices(remembered, others, len(remembered))
    led = yield from _led(_best(others, fits, _LED), remembered, config, rng)
    # The belief is led to its peak too: otherwise the others would win only by being at theirs.
    own = yield from _led(held, remembered, config, rng)
    if led is None or own is None:
        return None
    # Some may have been led into the place where the search ended.
    led = led[are_apart(led, belief.best, config.search)]
    logs = remembered(led)
    near = logs > remembered(own).max() - config.search.alike_within * len(remembered)
    return led[near] if near.any() else None


def are_apart(
    poses: NDArray[np.float64], place: Cluster, config: SearchConfig
) -> NDArray[np.bool_]:
    """Return which poses (n, 3) are not in a place, (n,)."""
    off_m = np.hypot(poses[:, 0] - place.mean.x_m, poses[:, 1] - place.mean.y_m)
    off_rad = poses[:, 2] - place.mean.theta_rad
    off_rad = np.abs(np.arctan2(np.sin(off_rad), np.cos(off_rad)))
    apart: NDArray[np.bool_] = (off_m >= config.apart_m) | (off_rad >= config.apart_rad)
    return apart


def _image(poses: NDArray[np.float64], motion: SE2) -> NDArray[np.float64]:
    """Return poses (n, 3) after a motion in world."""
    c, s = math.cos(motion.theta_rad), math.sin(motion.theta_rad)
    x = motion.x_m + c * poses[:, 0] - s * poses[:, 1]
    y = motion.y_m + s * poses[:, 0] + c * poses[:, 1]
    theta = poses[:, 2] + motion.theta_rad
    return np.stack([x, y, theta - math.tau * np.round(theta / math.tau)], axis=1)


def _best(poses: NDArray[np.float64], logs: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    count = min(count, len(poses))
    return poses[np.argpartition(-logs, count - 1)[:count]]


def _led(
    poses: NDArray[np.float64], remembered: Remembered, config: MclConfig, rng: np.random.Generator
) -> Sliced[NDArray[np.float64] | None]:
    """Return poses after they have been drawn to the peaks nearby."""
    alike = np.full(len(poses), 1.0 / len(poses))
    logs = yield from evaluated_in_slices(remembered, poses, len(remembered))
    found = yield from anneal(
        poses,
        alike,
        logs,
        remembered,
        len(poses),
        config.bins,
        config.search_floor,
        rng,
        len(remembered),
    )
    return None if found is None else found[0]
