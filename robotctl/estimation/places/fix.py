"""A recognised place as a measurement for Monte Carlo localisation.

Each candidate is a Gaussian about its pose, weighed by how alike it is; a recognition may also be
wrong, and then the robot may be anywhere, as with the K of `range_mixture.py`::

    p(x) = (1 - wrong) sum_c w_c N(x; pose_c, s^2 P_c) + wrong / (2 pi area)

So K needs no tuning: it is the density of a robot that is somewhere on the map.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.places.places import SonarCandidate, SonarRecognition
from robotctl.estimation.ranging.log_likelihood import LogLikelihood


@dataclass(frozen=True, slots=True)
class PlaceFixConfig:
    """Trust in a recognised place.

    Parameters
    ----------
    wrong
        Probability that none of the candidates is right, (0, 1).
    widen
        The standard deviations of the candidates are multiplied by this, >= 1: the robot does not
        stand about a place as a Gaussian would have it.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    wrong: float = 0.05
    widen: float = 2.0

    def __post_init__(self) -> None:
        if not 0.0 < self.wrong < 1.0:
            raise ValueError(f"wrong must be in (0, 1), found {self.wrong}")
        if not 1.0 <= self.widen < math.inf:
            raise ValueError(f"widen must be finite and >= 1, found {self.widen}")


def place_fix(
    recognition: SonarRecognition, area_m2: float, config: PlaceFixConfig | None = None
) -> LogLikelihood | None:
    """Return the function from poses to the log-likelihood of a recognition.

    All candidates in `world` count, also where the recognition is refused since it is ambiguous.

    Parameters
    ----------
    recognition
        Measured at the robot's present place.
    area_m2
        Of the floor on which it can be [m^2], > 0.
    config
        Settings.

    Returns
    -------
    LogLikelihood or None
        None if there is no candidate in `world`. The best pose has about 0.

    Raises
    ------
    ValueError
        If the area is not > 0.
    """
    if not 0.0 < area_m2 < math.inf:
        raise ValueError(f"area_m2 must be finite and > 0, found {area_m2}")
    config = config or PlaceFixConfig()
    placed = [each for each in recognition.candidates if each.in_world]
    if not placed:
        return None
    trusted = 1.0 - config.wrong
    weights = np.array([each.score for each in placed])
    heights = np.log(trusted * weights / weights.sum())
    roots = np.linalg.cholesky(config.widen**2 * np.array([each.covariance for each in placed]))
    heights -= np.log(np.linalg.det(roots)) + 1.5 * math.log(math.tau)
    anywhere = math.log(config.wrong / (math.tau * area_m2))
    best = float(np.logaddexp(heights.max(), anywhere))

    def log_likelihood(poses: NDArray[np.float64]) -> NDArray[np.float64]:
        parts = [
            height - 0.5 * _squared_distance(poses, candidate, root)
            for height, candidate, root in zip(heights, placed, roots, strict=True)
        ]
        parts.append(np.full(len(poses), anywhere))
        found: NDArray[np.float64] = np.logaddexp.reduce(parts, axis=0) - best
        return found

    return log_likelihood


def _squared_distance(
    poses: NDArray[np.float64], candidate: SonarCandidate, root: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return Mahalanobis' distance squared from a candidate, (n,); `root` is Cholesky's."""
    off = poses - (candidate.pose.x_m, candidate.pose.y_m, candidate.pose.theta_rad)
    off[:, 2] -= math.tau * np.round(off[:, 2] / math.tau)
    white = np.linalg.solve(root, off.T)
    squared: NDArray[np.float64] = np.square(white).sum(axis=0)
    return squared
