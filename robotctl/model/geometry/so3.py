"""SO(3): rotation vectors and unit quaternions, and the series that SE(3) needs.

Quaternions are (w, x, y, z), Hamilton's convention, with w >= 0 if an operation returns one.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

Vector: TypeAlias = NDArray[np.float64]
Matrix: TypeAlias = NDArray[np.float64]
Quaternion: TypeAlias = tuple[float, float, float, float]

_SERIES_BELOW = 1.0
_TERMS = 9


class Coefficients(NamedTuple):
    """Functions of the rotation angle t in SO(3) and SE(3); all are even in t."""

    b: float
    """(1 - cos t) / t^2."""
    c: float
    """(t - sin t) / t^3."""
    d: float
    """(t^2 + 2 cos t - 2) / (2 t^4)."""


def _series(first: int) -> tuple[float, ...]:
    """Return (-1)^k / (2 k + first)! for k = 0, 1, ..."""
    return tuple((-1) ** k / math.factorial(2 * k + first) for k in range(_TERMS))


_B = _series(2)
_C = _series(3)
_D = _series(4)


def _horner(coefficients: tuple[float, ...], t2: float) -> float:
    value = 0.0
    for coefficient in reversed(coefficients):
        value = value * t2 + coefficient
    return value


def coefficients(angle_rad: float) -> Coefficients:
    """Return the coefficients at `angle_rad`, from their power series below 1 rad."""
    t = abs(angle_rad)
    t2 = t * t
    if t < _SERIES_BELOW:
        return Coefficients(_horner(_B, t2), _horner(_C, t2), _horner(_D, t2))
    cos, sin = math.cos(t), math.sin(t)
    return Coefficients(
        (1.0 - cos) / t2,
        (t - sin) / (t2 * t),
        (t2 + 2.0 * cos - 2.0) / (2.0 * t2 * t2),
    )


def hat(vector: Vector) -> Matrix:
    """Return the matrix [v]x, (3, 3), with [v]x u = v x u."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def left_jacobian(phi: Vector) -> Matrix:
    """Return J_l(phi) of SO(3), (3, 3), for the rotation vector `phi` (3,) [rad]."""
    k = coefficients(float(np.linalg.norm(phi)))
    P = hat(phi)
    return np.eye(3) + k.b * P + k.c * (P @ P)


def left_jacobian_inverse(phi: Vector) -> Matrix:
    """Return the inverse of J_l(phi), (3, 3), for |phi| < 2 pi."""
    angle = float(np.linalg.norm(phi))
    k = coefficients(angle)
    P = hat(phi)
    # (1 - (t/2) cot(t/2)) / t^2 = (2 b - a) / (2 b t^2) with a = sin t / t = 1 - c t^2
    # and b = 1/2 - d t^2
    weight = (k.c - 2.0 * k.d) / (2.0 * k.b)
    return np.eye(3) - 0.5 * P + weight * (P @ P)


def quaternion_exp(phi: Vector) -> Quaternion:
    """Return the unit quaternion of the rotation vector `phi` (3,) [rad]."""
    x, y, z = (float(value) for value in phi)
    half = 0.5 * math.sqrt(x * x + y * y + z * z)
    scale = 0.5 * (math.sin(half) / half if half > 1e-4 else 1.0 - half * half / 6.0)
    return canonical((math.cos(half), scale * x, scale * y, scale * z))


def quaternion_log(q: Quaternion) -> Vector:
    """Return the rotation vector of the quaternion `q`, (3,), of length in [0, pi] [rad].

    Good at every angle: from |vector part| and w by atan2, not from a trace by acos, which loses
    half of the digits near 0 and near pi. At exactly pi both axes are right; one is returned.
    """
    w, x, y, z = canonical(q)
    n = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 * math.atan2(n, w) / n if n > 1e-7 else 2.0 / w
    return np.array([scale * x, scale * y, scale * z])


def quaternion_product(p: Quaternion, q: Quaternion) -> Quaternion:
    """Return the Hamilton product p q, normalised against drift."""
    pw, px, py, pz = p
    qw, qx, qy, qz = q
    return canonical(
        (
            pw * qw - px * qx - py * qy - pz * qz,
            pw * qx + px * qw + py * qz - pz * qy,
            pw * qy - px * qz + py * qw + pz * qx,
            pw * qz + px * qy - py * qx + pz * qw,
        )
    )


def canonical(q: Quaternion) -> Quaternion:
    """Return `q` scaled to length 1 with w >= 0.

    Raises
    ------
    ValueError
        If `q` has no direction: all zero or not finite.
    """
    w, x, y, z = q
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    if not (norm > 0.0 and math.isfinite(norm)):
        raise ValueError(f"not a rotation: quaternion {q}")
    if w < 0.0:
        norm = -norm
    return w / norm, x / norm, y / norm, z / norm


def rotation_matrix(q: Quaternion) -> Matrix:
    """Return the rotation matrix, (3, 3), of the unit quaternion `q`."""
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
