"""Weighted samples of a pose: normalisation, effective size, resampling, mean and covariance.

Thrun, Burgard, Fox: Probabilistic Robotics, chapters 4 and 8. Poses are (n, 3) [m, m, rad],
weights (n,), not negative, of sum 1.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.model.geometry.se2 import SE2


def normalised(log_weights: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Return weights of sum 1 and the logarithm of the sum that they had.

    The greatest is taken out before `exp`, so that products of many small likelihoods neither
    vanish nor overflow.

    Parameters
    ----------
    log_weights
        (n,), n > 0; -inf is a weight of 0.

    Raises
    ------
    ValueError
        If all weights are 0, or one is nan or +inf.
    """
    greatest = float(log_weights.max())
    if not math.isfinite(greatest):
        raise ValueError(f"log_weights: the greatest must be finite, found {greatest}")
    weights = np.exp(log_weights - greatest)
    total = float(weights.sum())
    weights /= total
    return weights, greatest + math.log(total)


def posterior(
    weights: NDArray[np.float64], log_likelihoods: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """Return the weights after Bayes' rule, of sum 1, and the log-evidence log sum w L.

    Where the measurement is impossible for all particles, the evidence is -inf and the weights
    stay as they were.

    Parameters
    ----------
    weights, log_likelihoods
        (n,) each.
    """
    # A weight of 0 has the logarithm -inf, which is right here.
    with np.errstate(divide="ignore"):
        log_weights = np.log(weights) + log_likelihoods
    if log_weights.max() == -math.inf:
        return weights, -math.inf
    return normalised(log_weights)


def effective_size(weights: NDArray[np.float64]) -> float:
    """Return how many equal weights are worth as much: 1 / sum w^2 (Kong, Liu, Wong 1994)."""
    return 1.0 / float(weights @ weights)


def resample_systematic(
    weights: NDArray[np.float64], count: int, rng: np.random.Generator
) -> NDArray[np.int64]:
    """Draw `count` particles in proportion to their weights, with low variance.

    One random number shifts a comb of `count` equal steps over the cumulated weights (Probabilistic
    Robotics, table 4.4). Particle i is taken count * w_i times, rounded down or
    up, and that often in the mean.

    Parameters
    ----------
    weights
        (n,), not negative, of any sum > 0.
    count
        Particles to draw, >= 1.
    rng
        Gives the one random number.

    Returns
    -------
    NDArray
        Indices of the drawn particles, (count,), ascending; never one of weight 0.
    """
    indices = np.empty(count, np.int64)
    _comb(weights, float(weights.sum()) / count, rng.random(), indices)
    return indices


@compiled
def _comb(
    weights: NDArray[np.float64], step: float, shift: float, indices: NDArray[np.int64]
) -> None:
    """Fill `indices` with the particle under each tooth of the comb."""
    # Rounding may put the last tooth past the sum: never take a particle of weight 0.
    last = len(weights) - 1
    while last > 0 and weights[last] == 0.0:
        last -= 1
    i = 0
    cumulated = weights[0]
    for k in range(len(indices)):
        tooth = (k + shift) * step
        while i < last and tooth >= cumulated:
            i += 1
            cumulated += weights[i]
        indices[k] = i


def weighted_mean(poses: NDArray[np.float64], weights: NDArray[np.float64]) -> SE2:
    """Return the mean pose, with the heading on the circle: atan2(sum w sin, sum w cos).

    Parameters
    ----------
    poses, weights
        (n, 3) and (n,), weights of any sum > 0.
    """
    total, x, y, cos, sin = _sums(poses, weights)
    return SE2(x / total, y / total, math.atan2(sin, cos))


@compiled
def _sums(
    poses: NDArray[np.float64], weights: NDArray[np.float64]
) -> tuple[float, float, float, float, float]:
    """Return the sums of w, w x, w y, w cos(theta) and w sin(theta)."""
    total, x, y, cos, sin = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(len(poses)):
        w = weights[i]
        total += w
        x += w * poses[i, 0]
        y += w * poses[i, 1]
        cos += w * math.cos(poses[i, 2])
        sin += w * math.sin(poses[i, 2])
    return total, x, y, cos, sin


def weighted_covariance(
    poses: NDArray[np.float64], weights: NDArray[np.float64], mean: SE2
) -> NDArray[np.float64]:
    """Return the covariance of (x, y, theta) about a mean, (3, 3), headings by the shorter arc."""
    covariance = np.empty((3, 3))
    _spread(poses, weights, mean.x_m, mean.y_m, mean.theta_rad, covariance)
    return covariance


@compiled
def _spread(
    poses: NDArray[np.float64],
    weights: NDArray[np.float64],
    x: float,
    y: float,
    theta: float,
    covariance: NDArray[np.float64],
) -> None:
    """Fill `covariance` with the second moments about a mean."""
    turn = 2.0 * math.pi
    total, xx, xy, yy, xt, yt, tt = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(len(poses)):
        w, dx, dy = weights[i], poses[i, 0] - x, poses[i, 1] - y
        dt = poses[i, 2] - theta
        dt -= turn * np.rint(dt / turn)
        total += w
        xx += w * dx * dx
        xy += w * dx * dy
        yy += w * dy * dy
        xt += w * dx * dt
        yt += w * dy * dt
        tt += w * dt * dt
    covariance[0, 0], covariance[1, 1], covariance[2, 2] = xx / total, yy / total, tt / total
    covariance[0, 1] = covariance[1, 0] = xy / total
    covariance[0, 2] = covariance[2, 0] = xt / total
    covariance[1, 2] = covariance[2, 1] = yt / total
