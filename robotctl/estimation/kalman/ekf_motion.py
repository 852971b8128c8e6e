"""How the state (x, y, theta, v, omega[, gyro bias]) of the pose EKF moves, and how it blurs."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.kalman.ekf_config import EkfConfig
from robotctl.model.drives.motion import arc
from robotctl.model.drives.motion_noise import added_covariance, pose_jacobian
from robotctl.model.geometry.se2 import SE2

Array: TypeAlias = NDArray[np.float64]
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)


def moved(
    x: Array, distance_m: float, turn_rad: float, dt_s: float, config: EkfConfig
) -> tuple[Array, Array, Array]:
    """Return the state after an arc that encoders counted, its Jacobian F, and the noise Q.

    The errors of distance and turn are white along the arc (`motion_noise.py`), and they
    make the errors of pose and velocities alike: with n = (errors of distance and turn) in all,
    cov(pose, n) is the mean of what a unit of each does to the end of the arc.
    """
    start = SE2(float(x[0]), float(x[1]), float(x[2]))
    end = arc(start, distance_m, turn_rad)
    after = x.copy()
    after[:5] = end.x_m, end.y_m, end.theta_rad, distance_m / dt_s, turn_rad / dt_s
    F = np.eye(len(x))
    F[:3, :3] = pose_jacobian(start, distance_m, turn_rad)
    F[3, 3] = F[4, 4] = 0.0
    noise = config.motion
    along = noise.e_m_per_sqrt_m**2 * abs(distance_m)
    turning = noise.f_rad_per_sqrt_m**2 * abs(distance_m)
    turning += noise.g_rad_per_sqrt_rad**2 * abs(turn_rad)
    ux, uy, bx, by = _mean_effects(start.theta_rad, distance_m, turn_rad)
    Q = np.zeros((len(x), len(x)))
    Q[:3, :3] = added_covariance(start, distance_m, turn_rad, noise)
    Q[:3, 3] = Q[3, :3] = along / dt_s * np.array([ux, uy, 0.0])
    Q[:3, 4] = Q[4, :3] = turning / dt_s * np.array([bx, by, 1.0])
    Q[3, 3] = along / dt_s**2 + config.velocity_sigma_m_s**2
    Q[4, 4] = turning / dt_s**2 + config.turn_rate_sigma_rad_s**2
    _walk(Q, dt_s, config)
    return after, F, Q


def coasted(x: Array, dt_s: float, config: EkfConfig) -> tuple[Array, Array, Array]:
    """Return the state after a time with constant velocities, its Jacobian F, and the noise Q.

    Velocities change by white acceleration (Bar-Shalom et al., section 6.2.2).
    """
    start = SE2(float(x[0]), float(x[1]), float(x[2]))
    distance, turn = float(x[3]) * dt_s, float(x[4]) * dt_s
    end = arc(start, distance, turn)
    after = x.copy()
    after[:3] = end.x_m, end.y_m, end.theta_rad
    ux, uy, bx, by = _mean_effects(start.theta_rad, distance, turn)
    by_v, by_omega = np.array([ux, uy, 0.0]), np.array([bx, by, 1.0])
    F = np.eye(len(x))
    F[:3, :3] = pose_jacobian(start, distance, turn)
    F[:3, 3], F[:3, 4] = dt_s * by_v, dt_s * by_omega
    Q = np.zeros((len(x), len(x)))
    pairs = (
        (3, by_v, config.acceleration_m_s2),
        (4, by_omega, config.turn_acceleration_rad_s2),
    )
    for i, effect, density in pairs:
        Q[:3, :3] += density**2 * dt_s**3 / 3.0 * np.outer(effect, effect)
        Q[:3, i] = Q[i, :3] = density**2 * dt_s**2 / 2.0 * effect
        Q[i, i] = density**2 * dt_s
    _walk(Q, dt_s, config)
    return after, F, Q


def _mean_effects(
    theta_rad: float, distance_m: float, turn_rad: float
) -> tuple[float, float, float, float]:
    """Return what 1 m more and 1 rad more, spread over an arc, do to its end (x and y of each).

    The first is the mean direction of travel, the second a quarter turn of the mean way from a
    point of the arc to its end.
    """
    pieces = max(1, math.ceil(abs(turn_rad)))
    s = (np.arange(pieces)[:, None] + 0.5 * (_NODES + 1.0)).ravel() / pieces
    weights = np.tile(0.5 * _WEIGHTS, pieces) / pieces
    direction = theta_rad + turn_rad * s
    c, sin = weights * np.cos(direction), weights * np.sin(direction)
    return float(c.sum()), float(sin.sum()), -distance_m * float(sin @ s), distance_m * float(c @ s)


def _walk(Q: Array, dt_s: float, config: EkfConfig) -> None:
    """Add the walk of the gyro's bias."""
    if config.gyro:
        Q[5, 5] = config.gyro_bias_walk_rad_s**2 * dt_s
