"""The estimate of a set of particles: its heaviest cluster, with mean and covariance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.mcl.particles import weighted_covariance, weighted_mean
from robotctl.estimation.mcl.pose_bins import BinSize, connected_bins
from robotctl.model.geometry.se2 import SE2


@dataclass(frozen=True, slots=True, eq=False)
class Cluster:
    """Particles that hang together.

    Parameters
    ----------
    weight
        Their share of the belief, in (0, 1].
    mean
        Pose of `base` in `world`, heading on the circle.
    covariance
        Covariance of (x, y, theta), (3, 3) [m, m, rad].
    """

    weight: float
    mean: SE2
    covariance: NDArray[np.float64]

    @property
    def sigma_m(self) -> float:
        """Standard deviation along the longest axis of the position's ellipse [m]."""
        return math.sqrt(max(0.0, float(np.linalg.eigvalsh(self.covariance[:2, :2])[-1])))

    @property
    def sigma_rad(self) -> float:
        """Standard deviation of the heading [rad]."""
        return math.sqrt(max(0.0, float(self.covariance[2, 2])))


def clusters(
    poses: NDArray[np.float64], weights: NDArray[np.float64], size: BinSize, most: int
) -> list[Cluster]:
    """Return up to `most` clusters, the heaviest first.

    Parameters
    ----------
    poses, weights
        The belief, (n, 3) and (n,) of sum 1.
    size
        Bins whose neighbourhood makes a cluster.
    most
        Clusters wanted, >= 1.
    """
    labels = connected_bins(poses, size)
    masses = np.bincount(labels, weights)
    if len(masses) == 1:
        return [_cluster(poses, weights)]
    heaviest = np.argsort(-masses, kind="stable")[:most]
    inside = (labels == label for label in heaviest if masses[label] > 0.0)
    return [_cluster(poses[its], weights[its]) for its in inside]


def _cluster(poses: NDArray[np.float64], weights: NDArray[np.float64]) -> Cluster:
    mean = weighted_mean(poses, weights)
    return Cluster(float(weights.sum()), mean, weighted_covariance(poses, weights, mean))
