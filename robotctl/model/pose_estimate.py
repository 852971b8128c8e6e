"""What an estimator believes of the robot's pose."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robotctl.model.se2 import SE2


class LocalisationStatus(enum.IntEnum):
    """How far a pose estimate may be trusted."""

    SEARCHING = 0
    """The belief is spread or has several clusters: the pose is a guess."""
    LOCALISED = 1
    """One compact belief that agrees with what is measured."""
    LOST = 2
    """The belief contradicts what is measured."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseEstimate:
    """A pose with its uncertainty.

    Parameters
    ----------
    stamp_ns
        Time that the pose belongs to [ns].
    pose
        `base` in `world`.
    covariance
        Of (x, y, theta) in `world`, (3, 3) [m, m, rad].
    status
        How far it may be trusted.
    """

    stamp_ns: int
    pose: SE2
    covariance: NDArray[np.float64]
    status: LocalisationStatus
