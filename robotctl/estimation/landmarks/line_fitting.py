"""Straight lines through points of a range sensor, and corners where two of them meet.

A line is x cos(alpha) + y sin(alpha) = r. Least squares of the distances d_i from the line,
weighted by w_i, have a closed form (Arras and Siegwart, Feature Extraction and Scene Interpretation
for Map-Based Navigation and Map Building, SPIE 3210, 1997): with the weighted means of x and y and
the differences u, v from them

    tan(2 alpha) = N / D,   N = -2 sum(w u v),   D = sum(w (v^2 - u^2)),
    r = mean(x) cos(alpha) + mean(y) sin(alpha).

The covariance of (alpha, r) follows to first order from that of the points, which have noise of
range and of bearing. Weights are 1 / variance of d_i; the variance depends on the line's direction,
so the line is fitted twice. Then sum(d_i^2 w_i) is chi-squared with n - 2 degrees of freedom.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.angles import wrap_angle

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class BeamNoise:
    """Noise of single beams, which are independent of each other.

    Parameters
    ----------
    sigma_m, sigma_per_m
        Standard deviation of a range: sigma_m + sigma_per_m * range [m], [1], > 0 and >= 0.
    bearing_sigma_rad
        Standard deviation of the direction of a beam [rad], >= 0.

    Raises
    ------
    ValueError
        If a number is out of its range.
    """

    sigma_m: float = 0.015
    sigma_per_m: float = 0.0
    bearing_sigma_rad: float = 0.002

    def __post_init__(self) -> None:
        if not 0.0 < self.sigma_m < math.inf:
            raise ValueError(f"sigma_m must be finite and > 0, found {self.sigma_m}")
        for key in ("sigma_per_m", "bearing_sigma_rad"):
            if not 0.0 <= getattr(self, key) < math.inf:
                raise ValueError(f"{key} must be finite and >= 0, found {getattr(self, key)}")

    def covariances(self, ranges_m: Array, angles_rad: Array) -> Array:
        """Return the covariances of the end points of beams, (n, 2, 2) [m^2].

        Parameters
        ----------
        ranges_m, angles_rad
            Of the beams, (n,) [m], [rad]; the end points are in the frame of the angles.
        """
        c, s = np.cos(angles_rad), np.sin(angles_rad)
        along = (self.sigma_m + self.sigma_per_m * ranges_m) ** 2
        across = (ranges_m * self.bearing_sigma_rad) ** 2
        xy = (along - across) * c * s
        found = np.array(
            [[along * c * c + across * s * s, xy], [xy, along * s * s + across * c * c]]
        )
        return found.transpose(2, 0, 1)


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """A straight line in normal form, x cos(alpha) + y sin(alpha) = r.

    Parameters
    ----------
    alpha_rad
        Direction of the normal, from the origin to the line, in (-pi, pi] [rad].
    r_m
        Distance from the origin [m], >= 0.
    covariance
        Of (alpha, r), (2, 2) [rad, m].
    chi2
        Squared distances of the points, each over its variance, summed.
    points
        How many were fitted.
    """

    alpha_rad: float
    r_m: float
    covariance: Array
    chi2: float
    points: int

    @property
    def normal(self) -> Array:
        """Unit vector from the origin towards the line, (2,)."""
        return np.array([math.cos(self.alpha_rad), math.sin(self.alpha_rad)])

    def distances_m(self, points: Array) -> Array:
        """Return the signed distances of points (n, 2), positive beyond the line, (n,) [m]."""
        found: Array = points @ self.normal - self.r_m
        return found


def fit_line(points: Array, covariances: Array) -> Line:
    """Return the line with the least weighted squares of distances, and its covariance.

    Parameters
    ----------
    points
        (n, 2) [m], n >= 2.
    covariances
        Of the points, (n, 2, 2) [m^2]; positive definite.

    Raises
    ------
    ValueError
        If shapes do not fit, points are too few, not finite, or spread alike in all directions.
    """
    n = len(points)
    if points.shape != (n, 2) or covariances.shape != (n, 2, 2) or n < 2:
        raise ValueError(
            f"points must be (n, 2) and covariances (n, 2, 2), n >= 2, found {points.shape} and "
            f"{covariances.shape}"
        )
    if not np.all(np.isfinite(points)):
        raise ValueError("points must be finite")
    alpha, _, _ = _fitted(points, np.ones(n))
    weights = 1.0 / across(covariances, alpha)
    alpha, r, jacobian = _fitted(points, weights)
    covariance = np.einsum("ika,kab,jkb->ij", jacobian, covariances, jacobian)
    if r < 0.0:
        # The same line seen from its other side: d(-r) = -dr.
        alpha, r = alpha + math.pi, -r
        covariance[0, 1] = covariance[1, 0] = -covariance[0, 1]
    line = Line(wrap_angle(alpha), r, covariance, 0.0, n)
    off = line.distances_m(points)
    chi2 = float(np.sum(off * off / across(covariances, alpha)))
    return Line(line.alpha_rad, r, covariance, chi2, n)


def across(covariances: Array, alpha_rad: float) -> Array:
    """Return the variances of points (n, 2, 2) along a normal, (n,) [m^2]."""
    normal = np.array([math.cos(alpha_rad), math.sin(alpha_rad)])
    found: Array = np.einsum("a,nab,b->n", normal, covariances, normal)
    return found


def _fitted(points: Array, weights: Array) -> tuple[float, float, Array]:
    """Return alpha, r and their derivatives by the points, (2, n, 2), at fixed weights."""
    total = weights.sum()
    mean = weights @ points / total
    u, v = (points - mean).T
    numerator = -2.0 * float(np.sum(weights * u * v))
    denominator = float(np.sum(weights * (v * v - u * u)))
    square = numerator**2 + denominator**2
    spread = float(np.sum(weights * (u * u + v * v)))
    if square <= (1e-9 * spread) ** 2:
        raise ValueError(
            "points spread equally in all directions: no line fits better than another"
        )
    alpha = 0.5 * math.atan2(numerator, denominator)
    c, s = math.cos(alpha), math.sin(alpha)
    by_alpha = weights[:, np.newaxis] * np.stack(
        [numerator * u - denominator * v, -(denominator * u + numerator * v)], axis=1
    )
    by_alpha /= square
    along = float(mean[1] * c - mean[0] * s)
    by_r = np.outer(weights / total, [c, s]) + along * by_alpha
    return alpha, float(mean[0] * c + mean[1] * s), np.stack([by_alpha, by_r])


@dataclass(frozen=True, slots=True, eq=False)
class Corner:
    """Corner: the point where two lines meet.

    Parameters
    ----------
    position
        (2,) [m], in the frame of the lines.
    covariance
        Of the position, (2, 2) [m^2].
    """

    position: Array
    covariance: Array


def intersection(first: Line, second: Line) -> Corner:
    """Return where two lines, found from different points, meet.

    Raises
    ------
    ValueError
        If they are parallel.
    """
    lines = (first, second)
    rows = np.array([line.normal for line in lines])
    if abs(np.linalg.det(rows)) < 1e-9:
        raise ValueError("the lines are parallel")
    inverse = np.linalg.inv(rows)
    position = inverse @ [line.r_m for line in lines]
    covariance = np.zeros((2, 2))
    for line, column in zip(lines, inverse.T, strict=True):
        nx, ny = line.normal
        jacobian = np.outer(column, [ny * position[0] - nx * position[1], 1.0])
        covariance += jacobian @ line.covariance @ jacobian.T
    return Corner(position, covariance)
