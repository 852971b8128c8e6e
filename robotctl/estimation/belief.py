"""What a set of particles says: its heaviest cluster, where that lies and how sure it is."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.particles import weighted_covariance, weighted_mean
from robotctl.estimation.pose_bins import BinSize, connected_bins
from robotctl.model.se2 import SE2


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
        Of (x, y, theta), (3, 3) [m, m, rad].
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
    heaviest = np.argsort(-masses, kind="stable")[:most]
    return [_cluster(poses, weights, labels == label) for label in heaviest if masses[label] > 0.0]


def _cluster(
    poses: NDArray[np.float64], weights: NDArray[np.float64], inside: NDArray[np.bool_]
) -> Cluster:
    its_poses, its_weights = poses[inside], weights[inside]
    mean = weighted_mean(its_poses, its_weights)
    covariance = weighted_covariance(its_poses, its_weights, mean)
    return Cluster(float(its_weights.sum()), mean, covariance)
