"""Adjoint and Jacobians of SE(2), with numpy, for estimators.

Perturbations stand on the right, in the body frame: T becomes `T @ exp(delta)` and a result f
becomes `f @ exp(J delta)`. Formulas: Sola, Deray, Atchuthan, "A micro Lie theory for state
estimation in robotics" (2018), numbers beside the lines.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.angles import sinc
from robotctl.model.geometry.se2 import SE2

Matrix: TypeAlias = NDArray[np.float64]


def adjoint(T: SE2) -> Matrix:
    """Return Ad(T), (3, 3): T exp(xi) = exp(Ad(T) xi) T (159)."""
    c, s = math.cos(T.theta_rad), math.sin(T.theta_rad)
    return np.array([[c, -s, T.y_m], [s, c, -T.x_m], [0.0, 0.0, 1.0]])


def left_jacobian(rho_x_m: float, rho_y_m: float, theta_rad: float) -> Matrix:
    """Return J_l(xi), (3, 3): exp(xi + d) = exp(J_l(xi) d) exp(xi) to first order (164)."""
    half = 0.5 * theta_rad
    a = sinc(theta_rad)
    b = math.sin(half) * sinc(half)  # (1 - cos theta) / theta
    c = _versine(theta_rad)
    d = 0.5 * sinc(half) ** 2  # (1 - cos theta) / theta^2
    return np.array(
        [
            [a, -b, c * rho_x_m + d * rho_y_m],
            [b, a, c * rho_y_m - d * rho_x_m],
            [0.0, 0.0, 1.0],
        ]
    )


def left_jacobian_inverse(rho_x_m: float, rho_y_m: float, theta_rad: float) -> Matrix:
    """Return the inverse of J_l(xi), (3, 3), for |theta| < 2 pi."""
    half = 0.5 * theta_rad
    h = math.cos(half) / sinc(half)
    J = left_jacobian(rho_x_m, rho_y_m, theta_rad)
    V_inverse = np.array([[h, half], [-half, h]])
    inverse = np.eye(3)
    inverse[:2, :2] = V_inverse
    inverse[:2, 2] = -V_inverse @ J[:2, 2]
    return inverse


def right_jacobian(rho_x_m: float, rho_y_m: float, theta_rad: float) -> Matrix:
    """Return J_r(xi) = J_l(-xi), (3, 3): exp(xi + d) = exp(xi) exp(J_r(xi) d) (163)."""
    return left_jacobian(-rho_x_m, -rho_y_m, -theta_rad)


def right_jacobian_inverse(rho_x_m: float, rho_y_m: float, theta_rad: float) -> Matrix:
    """Return the inverse of J_r(xi), (3, 3), for |theta| < 2 pi: the Jacobian of `log`."""
    return left_jacobian_inverse(-rho_x_m, -rho_y_m, -theta_rad)


def inverse_jacobian(T: SE2) -> Matrix:
    """Return the Jacobian of `T.inverse()` by T, (3, 3): -Ad(T) (160)."""
    return -adjoint(T)


def compose_jacobians(B: SE2) -> tuple[Matrix, Matrix]:
    """Return the Jacobians of `A @ B` by A and by B, (3, 3) each: Ad(B)^-1 and I (161, 162)."""
    return adjoint(B.inverse()), np.eye(3)


def apply_jacobians(T: SE2, x_m: float, y_m: float) -> tuple[Matrix, Matrix]:
    """Return the Jacobians of `T.apply(x, y)` by T, (2, 3), and by the point, (2, 2) (166, 167)."""
    c, s = math.cos(T.theta_rad), math.sin(T.theta_rad)
    by_T = np.array([[c, -s, -s * x_m - c * y_m], [s, c, c * x_m - s * y_m]])
    return by_T, by_T[:, :2].copy()


def _versine(theta_rad: float) -> float:
    """Return (theta - sin theta) / theta^2; a series near 0."""
    if abs(theta_rad) < 0.25:
        t = theta_rad * theta_rad
        series = 1.0 - t / 20.0 * (1.0 - t / 42.0 * (1.0 - t / 72.0 * (1.0 - t / 110.0)))
        return theta_rad / 6.0 * series
    return (theta_rad - math.sin(theta_rad)) / (theta_rad * theta_rad)
