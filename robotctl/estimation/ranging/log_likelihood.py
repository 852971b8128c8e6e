"""Log-likelihoods of poses: the one function by which sensors plug into the localiser."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

LogLikelihood: TypeAlias = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Maps poses of `base` in `world`, (n, 3) [m, m, rad], to the log-likelihood of one measurement at
each, (n,), up to a constant that is the same for all poses. The constant makes a perfect fit about
0, so that the localiser can detect a bad fit from the first measurement on."""


@runtime_checkable
class Forgiving(Protocol):
    """A log-likelihood of a sensor from which people and things can hide the map."""

    def __call__(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the log-likelihood at each pose, (n,)."""

    def forgiven(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the same, (n,), but that what is nearer than the map allows says little.

        It costs more, and is for a few poses: whether what a robot sees speaks against a place.
        """


COARSE_SHARE: Final = 0.4
"""Time that a coarse log-likelihood takes, as a share of that of the full one, about."""


@runtime_checkable
class Coarse(Protocol):
    """A log-likelihood that can be had of the surroundings of poses, too."""

    def __call__(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the log-likelihood at each pose, (n,)."""

    def coarse(self, side_m: float, turn_rad: float) -> LogLikelihood:
        """Return how well the measurement may fit near a pose: about the best that is there.

        Parameters
        ----------
        side_m, turn_rad
            Width of the surroundings: side of a square [m], and a range of headings [rad].
        """


def forgiven(log_likelihood: LogLikelihood, poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the log-likelihoods of poses, (n,), forgiving where the sensor can."""
    if isinstance(log_likelihood, Forgiving):
        return log_likelihood.forgiven(poses)
    return log_likelihood(poses)


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
