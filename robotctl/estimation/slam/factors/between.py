"""One pose seen from another: odometry, scan matches, loop closures.

The residual is Z^-1 (X_i^-1 X_j) in g2o's coordinates: x, y, theta in the plane; in space
translation and vector part of the unit quaternion with w >= 0, half the rotation vector to first
order. Both are in the frame of the measured pose. (GTSAM takes Log of SE(2) or SE(3) instead, with
the rotation first; its chi2 of the same graph differs.)
Kümmerle et al., g2o: a general framework for graph optimization, ICRA 2011.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from native_kernels.compiled import compiled
from robotctl.estimation.slam.factors.rotations import (
    compose_inverse,
    matrix,
    unrotate,
)
from robotctl.estimation.slam.graph.factor import FactorKind
from robotctl.estimation.slam.graph.variables import SE2, SE3, Floats, wrap


@compiled
def linearise_2d(
    a: Floats, b: Floats, z: Floats, residuals: Floats, by_a: Floats, by_b: Floats
) -> None:
    """Fill residuals (n, 3) and Jacobians (n, 3, 3) at poses a, b (n, 3), measured z (n, 3)."""
    for k in range(len(z)):
        ca, sa = np.cos(a[k, 2]), np.sin(a[k, 2])
        cz, sz = np.cos(z[k, 2]), np.sin(z[k, 2])
        dx, dy = b[k, 0] - a[k, 0], b[k, 1] - a[k, 1]
        px, py = ca * dx + sa * dy, ca * dy - sa * dx  # b seen from a
        ex, ey = px - z[k, 0], py - z[k, 1]
        residuals[k, 0] = cz * ex + sz * ey
        residuals[k, 1] = cz * ey - sz * ex
        residuals[k, 2] = wrap(b[k, 2] - a[k, 2] - z[k, 2])
        turn = b[k, 2] - a[k, 2] - z[k, 2]
        c, s = np.cos(turn), np.sin(turn)
        by_a[k, 0, 0], by_a[k, 0, 1], by_a[k, 0, 2] = -cz, -sz, cz * py - sz * px
        by_a[k, 1, 0], by_a[k, 1, 1], by_a[k, 1, 2] = sz, -cz, -sz * py - cz * px
        by_a[k, 2, 0], by_a[k, 2, 1], by_a[k, 2, 2] = 0.0, 0.0, -1.0
        by_b[k, 0, 0], by_b[k, 0, 1], by_b[k, 0, 2] = c, -s, 0.0
        by_b[k, 1, 0], by_b[k, 1, 1], by_b[k, 1, 2] = s, c, 0.0
        by_b[k, 2, 0], by_b[k, 2, 1], by_b[k, 2, 2] = 0.0, 0.0, 1.0


def residual_2d(a: Floats, b: Floats, z: Floats) -> Floats:
    """Return residuals (n, 3)."""
    ca, sa, cz, sz = np.cos(a[:, 2]), np.sin(a[:, 2]), np.cos(z[:, 2]), np.sin(z[:, 2])
    dx, dy = (b - a)[:, :2].T
    ex, ey = ca * dx + sa * dy - z[:, 0], ca * dy - sa * dx - z[:, 1]
    turn = b[:, 2] - a[:, 2] - z[:, 2]
    return np.column_stack([cz * ex + sz * ey, cz * ey - sz * ex, wrapped(turn)])


def wrapped(angles: Floats) -> Floats:
    """Return angles in [-pi, pi) [rad]."""
    result: Floats = angles - 2.0 * np.pi * np.floor((angles + np.pi) / (2.0 * np.pi))
    return result


@compiled
def linearise_3d(
    a: Floats, b: Floats, z: Floats, residuals: Floats, by_a: Floats, by_b: Floats
) -> None:
    """Fill residuals (n, 6) and Jacobians (n, 6, 6) at poses a, b (n, 7), measured z (n, 7)."""
    turned_z, turned = np.empty((3, 3)), np.empty((3, 3))
    p, q, e = np.empty(3), np.empty(4), np.empty(4)
    by_a[:] = 0.0
    by_b[:] = 0.0
    for k in range(len(z)):
        unrotate(a[k, 3:], b[k, :3], a[k, :3], p)  # b seen from a
        unrotate(z[k, 3:], p, z[k, :3], residuals[k])
        compose_inverse(a[k, 3:], b[k, 3:], q)
        compose_inverse(z[k, 3:], q, e)
        sign = 1.0 if e[3] >= 0.0 else -1.0
        x, y, t, w = sign * e[0], sign * e[1], sign * e[2], sign * e[3]
        residuals[k, 3], residuals[k, 4], residuals[k, 5] = x, y, t
        matrix(z[k, 3:], turned_z)
        matrix(e, turned)
        for i in range(3):
            for j in range(3):
                by_a[k, i, j] = -turned_z[j, i]
                by_b[k, i, j] = turned[i, j]
            # R_z^T [p]x
            by_a[k, i, 3] = turned_z[1, i] * p[2] - turned_z[2, i] * p[1]
            by_a[k, i, 4] = turned_z[2, i] * p[0] - turned_z[0, i] * p[2]
            by_a[k, i, 5] = turned_z[0, i] * p[1] - turned_z[1, i] * p[0]
            # -(w I - [v]x) R_z^T / 2
            by_a[k, 3, 3 + i] = -0.5 * (
                w * turned_z[i, 0] + t * turned_z[i, 1] - y * turned_z[i, 2]
            )
            by_a[k, 4, 3 + i] = -0.5 * (
                w * turned_z[i, 1] - t * turned_z[i, 0] + x * turned_z[i, 2]
            )
            by_a[k, 5, 3 + i] = -0.5 * (
                w * turned_z[i, 2] + y * turned_z[i, 0] - x * turned_z[i, 1]
            )
            by_b[k, 3 + i, 3 + i] = 0.5 * w
        by_b[k, 3, 4], by_b[k, 3, 5] = -0.5 * t, 0.5 * y
        by_b[k, 4, 3], by_b[k, 4, 5] = 0.5 * t, -0.5 * x
        by_b[k, 5, 3], by_b[k, 5, 4] = -0.5 * y, 0.5 * x


@compiled
def residual_3d(a: Floats, b: Floats, z: Floats) -> Floats:
    """Return residuals (n, 6)."""
    result = np.empty((len(z), 6))
    p, q, e = np.empty(3), np.empty(4), np.empty(4)
    for k in range(len(z)):
        unrotate(a[k, 3:], b[k, :3], a[k, :3], p)
        unrotate(z[k, 3:], p, z[k, :3], result[k])
        compose_inverse(a[k, 3:], b[k, 3:], q)
        compose_inverse(z[k, 3:], q, e)
        for i in range(3):
            result[k, 3 + i] = e[i] if e[3] >= 0.0 else -e[i]
    return result


BETWEEN_2D: Final = FactorKind("between poses", (SE2, SE2), 3, 3, residual_2d, linearise_2d)
BETWEEN_3D: Final = FactorKind(
    "between poses in space", (SE3, SE3), 7, 6, residual_3d, linearise_3d, quaternion=3
)
