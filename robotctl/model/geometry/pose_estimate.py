"""An estimator's pose estimate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.localisation import LocalisationStatus as LocalisationStatus  # noqa: PLC0414
from robotctl.model.geometry.se2 import SE2

_UPPER: Final = np.triu_indices(3)


@dataclass(frozen=True, slots=True, eq=False)
class PoseEstimate:
    """A pose with its uncertainty.

    Parameters
    ----------
    stamp_ns
        Time of the pose [ns].
    pose
        Pose of `base` in `world`.
    covariance
        Covariance of (x, y, theta) in `world`, (3, 3) [m, m, rad].
    status
        Reliability.
    """

    stamp_ns: int
    pose: SE2
    covariance: NDArray[np.float64]
    status: LocalisationStatus


def upper_triangle(covariance: NDArray[np.float64]) -> tuple[float, ...]:
    """Return the upper triangle of a covariance (3, 3), row by row, as messages carry it."""
    values: list[float] = covariance[_UPPER].tolist()
    return tuple(values)


def from_upper_triangle(values: Sequence[float]) -> NDArray[np.float64]:
    """Return the covariance (3, 3) whose upper triangle, row by row, is `values`."""
    covariance = np.zeros((3, 3))
    covariance[_UPPER] = values
    return covariance + np.triu(covariance, 1).T
