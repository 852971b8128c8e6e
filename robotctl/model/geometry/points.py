"""Points of the plane, many at once."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.se2 import SE2


def rotation(theta_rad: float) -> NDArray[np.float64]:
    """Return the matrix R (2, 2) for which `points @ R` rotates points (n, 2) by an angle."""
    c, s = math.cos(theta_rad), math.sin(theta_rad)
    return np.array([[c, s], [-s, c]])


def moved(T_a_b: SE2, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points (n, 2) of frame b in frame a [same unit as the pose]."""
    there: NDArray[np.float64] = points @ rotation(T_a_b.theta_rad) + (T_a_b.x_m, T_a_b.y_m)
    return there


def align(points: NDArray[np.float64], wanted: NDArray[np.float64]) -> SE2:
    """Return the rigid motion that maps points (n, 2) onto others with the least mean square error.

    Source: Horn, closed-form solution of absolute orientation (1987), in the plane.
    """
    centre, aim = points.mean(axis=0), wanted.mean(axis=0)
    p, q = points - centre, wanted - aim
    theta = math.atan2(float(np.sum(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0])), float(np.sum(p * q)))
    x, y = SE2(0.0, 0.0, theta).apply(float(centre[0]), float(centre[1]))
    return SE2(float(aim[0]) - x, float(aim[1]) - y, theta)
