"""Rotations in space inside compiled loops; unit quaternions are x, y, z, w as in files of g2o."""

from __future__ import annotations

from native_kernels.compiled import compiled
from robotctl.estimation.slam.graph.variables import Floats


@compiled
def unrotate(q: Floats, point: Floats, origin: Floats, result: Floats) -> None:
    """Write R(q)^T (point - origin), (3,)."""
    a, b, c = point[0] - origin[0], point[1] - origin[1], point[2] - origin[2]
    x, y, z, w = -q[0], -q[1], -q[2], q[3]
    p, r, s = y * c - z * b + w * a, z * a - x * c + w * b, x * b - y * a + w * c
    result[0] = a + 2.0 * (y * s - z * r)
    result[1] = b + 2.0 * (z * p - x * s)
    result[2] = c + 2.0 * (x * r - y * p)


@compiled
def compose_inverse(p: Floats, q: Floats, result: Floats) -> None:
    """Write p^-1 q, (4,)."""
    x, y, z, w = -p[0], -p[1], -p[2], p[3]
    result[0] = w * q[0] + x * q[3] + y * q[2] - z * q[1]
    result[1] = w * q[1] + y * q[3] + z * q[0] - x * q[2]
    result[2] = w * q[2] + z * q[3] + x * q[1] - y * q[0]
    result[3] = w * q[3] - x * q[0] - y * q[1] - z * q[2]


@compiled
def matrix(q: Floats, result: Floats) -> None:
    """Write the rotation matrix, (3, 3)."""
    x, y, z, w = q[0], q[1], q[2], q[3]
    result[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    result[0, 1] = 2.0 * (x * y - z * w)
    result[0, 2] = 2.0 * (x * z + y * w)
    result[1, 0] = 2.0 * (x * y + z * w)
    result[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    result[1, 2] = 2.0 * (y * z - x * w)
    result[2, 0] = 2.0 * (x * z - y * w)
    result[2, 1] = 2.0 * (y * z + x * w)
    result[2, 2] = 1.0 - 2.0 * (x * x + y * y)
