"""Growth of a pose's covariance with distance and angle: the noises e, f, g.

Davison's lectures (Robotics, Imperial College London: motion and uncertainty) add e (along) and f
(turning) after a straight piece, and g after a turn. Done once for a long stretch this misses that
an early heading error moves the robot sideways, and the result depends on how the path is cut. Here
e and f act along the whole path, as white noise per metre and per radian, which is the limit of
that step for ever shorter pieces. Covariances therefore compose exactly: two halves give the same
as the whole. They are covariances of (x, y, theta) in the fixed frame, (3, 3), to first order: good
while the heading is known to within about 0.3 rad.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.model.drives.motion import arc
from robotctl.model.drives.odometry_noise import MotionNoise
from robotctl.model.geometry.angles import sinc
from robotctl.model.geometry.se2 import SE2

__all__ = ["MotionNoise", "added_covariance", "pose_jacobian", "propagate"]

Matrix: TypeAlias = NDArray[np.float64]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_QUADRATURE = tuple(zip((0.5 * (_NODES + 1.0)).tolist(), _WEIGHTS.tolist(), strict=True))
"""Places along a piece, each with its weight; the weights sum to 2."""
_MAX_PIECE_RAD = 1.0
"""Turn of one quadrature piece: 8 nodes integrate it to rounding."""


def propagate(
    covariance: Matrix, pose: SE2, distance_m: float, angle_rad: float, noise: MotionNoise
) -> Matrix:
    """Return the covariance after an arc from `pose`: F P F^T + Q.

    Parameters
    ----------
    covariance
        P of (x, y, theta) at `pose`, (3, 3) [m, m, rad].
    pose
        Start of the arc.
    distance_m, angle_rad
        Signed length [m] and turn [rad] of the arc; 0 m is a turn on the spot.
    noise
        The three noises.
    """
    F = pose_jacobian(pose, distance_m, angle_rad)
    moved: Matrix = F @ covariance @ F.T + added_covariance(pose, distance_m, angle_rad, noise)
    return 0.5 * (moved + moved.T)


def pose_jacobian(pose: SE2, distance_m: float, angle_rad: float) -> Matrix:
    """Return the Jacobian F of the arc's end (x, y, theta) by its start, (3, 3)."""
    end = arc(pose, distance_m, angle_rad)
    F = np.eye(3)
    F[0, 2] = -(end.y_m - pose.y_m)
    F[1, 2] = end.x_m - pose.x_m
    return F


def added_covariance(pose: SE2, distance_m: float, angle_rad: float, noise: MotionNoise) -> Matrix:
    """Return the covariance Q that an arc adds, (3, 3).

    Q = |d| int_0^1 (e^2 u u^T + q b b^T) ds, with u(s) the direction of travel, b(s) the effect of
    a turn by 1 rad at s on the end of the arc, and q = f^2 + g^2 |angle / d| the variance of the
    heading per metre. Gauss-Legendre quadrature, which has no singularity near straight motion.
    """
    pieces = max(1, math.ceil(abs(angle_rad) / _MAX_PIECE_RAD))
    d, alpha = distance_m / pieces, angle_rad / pieces
    Q = _piece_covariance(pose, d, alpha, noise)
    for _ in range(1, pieces):
        pose = arc(pose, d, alpha)
        F = pose_jacobian(pose, d, alpha)
        Q = F @ Q @ F.T + _piece_covariance(pose, d, alpha, noise)
    return Q


def _piece_covariance(pose: SE2, d: float, alpha: float, noise: MotionNoise) -> Matrix:
    """Return Q of an arc of at most `_MAX_PIECE_RAD`, (3, 3).

    It uses plain floats: sums over eight nodes cost less than calls of numpy.
    """
    along = 0.5 * noise.e_m_per_sqrt_m**2 * abs(d)
    turning = 0.5 * (noise.f_rad_per_sqrt_m**2 * abs(d) + noise.g_rad_per_sqrt_rad**2 * abs(alpha))
    xx = xy = yy = xt = yt = tt = 0.0
    for share, weight in _QUADRATURE:
        theta = pose.theta_rad + alpha * share
        ux, uy = math.cos(theta), math.sin(theta)
        # from the point at s to the end: a chord of the rest of the arc
        half = 0.5 * alpha * (1.0 - share)
        chord = d * (1.0 - share) * sinc(half)
        bx, by = -chord * math.sin(theta + half), chord * math.cos(theta + half)
        a, b = along * weight, turning * weight
        xx += a * ux * ux + b * bx * bx
        xy += a * ux * uy + b * bx * by
        yy += a * uy * uy + b * by * by
        xt += b * bx
        yt += b * by
        tt += b
    return np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])
