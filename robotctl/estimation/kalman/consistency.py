"""Is a filter's covariance right: NIS and NEES against chi-squared bounds.

Source: Bar-Shalom, Li, Kirubarajan: Estimation with Applications to Tracking and Navigation,
section 5.4.
"""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.kalman.chi_squared import chi2_bounds, chi2_quantile
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.pose_estimate import PoseEstimate
from robotctl.model.geometry.se2 import SE2

if TYPE_CHECKING:
    from robotctl.estimation.kalman.robust_kalman import Innovation


def pose_nees(estimate: PoseEstimate, truth: SE2) -> float:
    """Return the squared error of a pose, normalised by its covariance; 3 degrees of freedom.

    inf if the covariance is singular: a belief without any doubt fits nothing.
    """
    error = np.array(
        [
            estimate.pose.x_m - truth.x_m,
            estimate.pose.y_m - truth.y_m,
            wrap_angle(estimate.pose.theta_rad - truth.theta_rad),
        ]
    )
    try:
        return float(error @ np.linalg.solve(estimate.covariance, error))
    except np.linalg.LinAlgError:
        return math.inf


def share_inside(values: NDArray[np.float64], dof: float, probability: float = 0.95) -> float:
    """Return which share of normalised squared errors lies inside the two-sided bounds.

    A filter that is too sure has too many above, one that is too modest too many below.
    """
    low, high = chi2_bounds(dof, probability)
    return float(np.mean((values >= low) & (values <= high)))


class InnovationWindow:
    """The last innovations, which show whether the belief is contradicted.

    One outlier says nothing, and sensors that fail now and then make some; a belief that is wrong
    makes nearly all of them too large. So it is the share that counts.

    Parameters
    ----------
    size
        Innovations that are looked at, > 0.
    contradicted_share
        Share of them beyond their 99.9 % bound from which on the belief is contradicted.
    """

    def __init__(self, size: int = 20, contradicted_share: float = 0.5) -> None:
        self._last: deque[Innovation] = deque(maxlen=size)
        self._contradicted_share = contradicted_share
        self._bounds: dict[int, float] = {}

    def reset(self) -> None:
        """Forget all."""
        self._last.clear()

    def add(self, innovation: Innovation) -> None:
        """Take in one more."""
        self._last.append(innovation)

    @property
    def nis_per_dof(self) -> float:
        """Mean of NIS over its degrees of freedom: 1 for a consistent filter; nan without any."""
        dof = sum(each.dof for each in self._last)
        return sum(each.nis for each in self._last) / dof if dof else float("nan")

    @property
    def contradicted(self) -> bool:
        """Whether a full quarter of the window or more is there, and too many are too large."""
        n = len(self._last)
        if 4 * n < (self._last.maxlen or 0):
            return False
        beyond = sum(each.nis > self._bound(each.dof) for each in self._last)
        return beyond >= self._contradicted_share * n

    def _bound(self, dof: int) -> float:
        """Return the 99.9 % bound."""
        if dof not in self._bounds:
            self._bounds[dof] = chi2_quantile(0.999, dof)
        return self._bounds[dof]
