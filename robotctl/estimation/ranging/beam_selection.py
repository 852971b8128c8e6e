"""Which beams of a scan are weighed, and how much they are worth together.

A number is evenly chosen. Given the pose they are not independent: they share the map's errors,
people and furniture that stand where the map has none, and the robot's motion during the scan. If
any two have the correlation rho, the sum of n log-likelihoods varies as that of n / (1 + (n - 1)
rho) independent beams (Kish's design effect); by its inverse, as the power alpha, the product is
tempered. On three lidar logs, at the reference poses, rho is 0.02 to 0.05, for 30, 60 and 180
beams alike (`python -m benchmarks sensors`), so n beams are never worth more than about 25.

People around the robot shorten beams of neighbouring directions, for many scans. Where the robot's
place is known well, such beams stand out: they contradict nearly all poses equally, so they do not
distinguish poses, and are left out (as nav2's AMCL does in its likelihood field). This is a
heuristic: which beams count is decided by the poses, so it must not hide from the localiser that it
is wrong. It therefore stays off while the poses are spread, and where it would leave out most
beams: then not the beams are wrong, but the poses. It is not on by default: beams that few poses
agree with are often those that say most, and the models forgive a share of wrong beams by
themselves (docs/results/localisation.md).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.ranging.likelihood_config import BeamSkipping

_JUDGES: Final = 256
"""Poses that judge the beams: a share among them is good to 3 %, sqrt(0.25 / 256)."""


def evenly_chosen(valid: NDArray[np.bool_], count: int) -> NDArray[np.intp]:
    """Return the indices of at most `count` of the valid beams, in equal steps."""
    indices = np.flatnonzero(valid)
    n = min(count, len(indices))
    steps = ((np.arange(n) + 0.5) * (len(indices) / max(n, 1))).astype(np.intp)
    chosen: NDArray[np.intp] = indices[steps]
    return chosen


def tempering(beams: int, correlation: float) -> float:
    """Return the power alpha of the product of this many beams, (0, 1]."""
    return 1.0 / (1.0 + max(beams - 1, 0) * correlation)


def judges(poses: NDArray[np.float64], skipping: BeamSkipping) -> NDArray[np.float64] | None:
    """Return a few of the poses (n, 3), evenly chosen; None if they are spread."""
    few = np.ascontiguousarray(poses[:: max(1, len(poses) // _JUDGES)])
    resultant = np.hypot(np.cos(few[:, 2]).mean(), np.sin(few[:, 2]).mean())
    if resultant < math.exp(-0.5 * skipping.spread_max_rad**2):
        return None
    return few if np.hypot(*few[:, :2].std(axis=0)) <= skipping.spread_max_m else None
