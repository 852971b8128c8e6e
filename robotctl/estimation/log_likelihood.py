"""What a measurement says of poses: the one function by which sensors plug into the localiser."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

LogLikelihood: TypeAlias = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""From poses of `base` in `world`, (n, 3) [m, m, rad], to the log-likelihood of one measurement at
each, (n,), up to a constant that is the same for all poses. The constant makes a perfect fit about
0, so that the localiser can tell from the first measurement on whether one fits badly."""


def evaluated(log_likelihood: LogLikelihood, poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the log-likelihoods of poses, (n,), after a check of what the function gives.

    Raises
    ------
    ValueError
        If there is not one for each pose, or one is nan or +inf.
    """
    logs = log_likelihood(poses)
    if logs.shape != (len(poses),):
        raise ValueError(f"log-likelihoods must be ({len(poses)},), found {logs.shape}")
    if len(logs) and not logs.max() < math.inf:
        bad = int(np.argmin(logs < math.inf))
        raise ValueError(f"log-likelihoods must be < inf, found {logs[bad]} at {poses[bad]}")
    return logs
