"""Innovations of a Kalman filter: reference minus dead reckoning.

Odometry errors accumulate, so the gaps between dead reckoning and a reference are correlated
throughout, and least squares over them would state intervals far too narrow. The innovations of the
filter that knows the growth law of `motion_noise.py` are independent of each other with unit
variance, if parameters and noises are right: what least squares needs.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled

OUTLIER = 3.0
"""Standard deviations beyond which innovations count as outliers and are trusted less (Huber)."""


@compiled
def whitened_innovations(
    stamps_s: NDArray[np.float64],
    moves: NDArray[np.float64],
    start: NDArray[np.float64],
    start_variance: NDArray[np.float64],
    growth: NDArray[np.float64],
    reference_s: NDArray[np.float64],
    reference: NDArray[np.float64],
    speed_m_s: NDArray[np.float64],
    reference_variance: NDArray[np.float64],
    lever_m: NDArray[np.float64],
    delay_s: float,
    outlier: float,
) -> tuple[NDArray[np.float64], float]:
    """Return the innovations of the references, whitened, and the log determinants' sum.

    Parameters
    ----------
    stamps_s
        Times of the odometry, (n + 1,) [s], not decreasing.
    moves
        Way, turn and way sideways between them, (n, 3) [m, rad, m].
    start, start_variance
        Pose at the first time and its variances, (3,) [m, m, rad].
    growth
        e^2 [m^2/m], f^2 [rad^2/m] and g^2 [rad], (3,).
    reference_s, reference
        Times (m,) [s] and poses (m, 3); a heading that is nan is not known.
    speed_m_s
        How fast the robot drove at each reference, (m,) [m/s].
    reference_variance
        Of its position (each axis), its heading and its time, (3,) [m^2, rad^2, s^2].
    lever_m
        Point of `base` that the reference follows, (2,) [m].
    delay_s
        Delay of the reference [s].
    outlier
        Standard deviations beyond which an innovation is trusted less; 0: never.

    Returns
    -------
    innovations
        (m, 3), 0 in the last column where the heading is not known.
    log_det
        Sum of the logarithms of the determinants of the innovations' covariances.
    """
    out = np.zeros((len(reference_s), 3))
    log_det = 0.0
    pose, P = start.copy(), np.diag(start_variance)
    step, done = 0, 0.0
    for i in range(len(reference_s)):
        goal = reference_s[i] - delay_s
        step, done = _follow(pose, P, stamps_s, moves, growth, goal, step, done)
        late = reference_variance[2] * speed_m_s[i] ** 2
        variance = np.array([reference_variance[0], reference_variance[1], late])
        log_det += _correct(pose, P, reference[i], variance, lever_m, outlier, out[i])
    return out, log_det


@compiled
def _follow(
    pose: NDArray[np.float64],
    P: NDArray[np.float64],
    stamps_s: NDArray[np.float64],
    moves: NDArray[np.float64],
    growth: NDArray[np.float64],
    goal: float,
    step: int,
    done: float,
) -> tuple[int, float]:
    """Move pose and covariance to a time [s]; return the step reached and the share of it done."""
    while step < len(moves) and goal > stamps_s[step]:
        share = 1.0
        if goal < stamps_s[step + 1]:
            share = (goal - stamps_s[step]) / (stamps_s[step + 1] - stamps_s[step])
        if share > done:
            _move(pose, P, (share - done) * moves[step], growth)
            done = share
        if share < 1.0:
            break
        step, done = step + 1, 0.0
    return step, done


@compiled
def _move(
    pose: NDArray[np.float64],
    P: NDArray[np.float64],
    move: NDArray[np.float64],
    growth: NDArray[np.float64],
) -> None:
    """Move pose and covariance along a short arc, whose noise is that of its chord."""
    d, half = move[0], 0.5 * move[1]
    shrink = math.sin(half) / half if abs(half) > 1e-4 else 1.0 - half * half / 6.0
    ux, uy = math.cos(pose[2] + half), math.sin(pose[2] + half)
    if move[2] != 0.0:  # along the chord, wherever the robot looks
        way = math.hypot(d, move[2])
        ux, uy = (d * ux - move[2] * uy) / way, (d * uy + move[2] * ux) / way
        d = way
    dx, dy = d * shrink * ux, d * shrink * uy
    pose[0] += dx
    pose[1] += dy
    pose[2] += move[1]
    # F P F^T with F = I + [-dy, dx, 0]^T [0, 0, 1]
    xt, yt, tt = P[0, 2], P[1, 2], P[2, 2]
    P[0, 0] += -2.0 * dy * xt + dy * dy * tt
    P[0, 1] += -dy * yt + dx * xt - dx * dy * tt
    P[1, 1] += 2.0 * dx * yt + dx * dx * tt
    P[0, 2] -= dy * tt
    P[1, 2] += dx * tt
    along = growth[0] * abs(d)
    turning = growth[1] * abs(d) + growth[2] * abs(move[1])
    P[0, 0] += along * ux * ux + turning * dy * dy / 3.0
    P[0, 1] += along * ux * uy - turning * dx * dy / 3.0
    P[1, 1] += along * uy * uy + turning * dx * dx / 3.0
    P[0, 2] -= turning * dy / 2.0
    P[1, 2] += turning * dx / 2.0
    P[2, 2] += turning
    P[1, 0], P[2, 0], P[2, 1] = P[0, 1], P[0, 2], P[1, 2]


@compiled
def _correct(
    pose: NDArray[np.float64],
    P: NDArray[np.float64],
    seen: NDArray[np.float64],
    variance: NDArray[np.float64],
    lever_m: NDArray[np.float64],
    outlier: float,
    white: NDArray[np.float64],
) -> float:
    """Apply one reference; write its white innovation, return the log determinant.

    `variance` is that of the position on each axis, of the heading, and along the way on top.
    With S = L L^T, the innovation r and G = P H^T L^-T, the white innovation is L^-1 r, the pose
    moves by G L^-1 r and the covariance falls by G G^T.
    """
    n = 2 if math.isnan(seen[2]) else 3
    c, s = math.cos(pose[2]), math.sin(pose[2])
    at_x, at_y = c * lever_m[0] - s * lever_m[1], s * lever_m[0] + c * lever_m[1]
    r = np.array([seen[0] - pose[0] - at_x, seen[1] - pose[1] - at_y, 0.0])
    if n == 3:
        gap = seen[2] - pose[2]
        r[2] = gap - 2.0 * math.pi * math.floor(gap / (2.0 * math.pi) + 0.5)
    G, L, u = np.empty((3, 3)), np.zeros((3, 3)), np.array([c, s])
    for i in range(3):
        G[i, 0], G[i, 1] = P[i, 0] - at_y * P[i, 2], P[i, 1] + at_x * P[i, 2]
        G[i, 2] = P[i, 2]
    log_det = _whiten(G, at_x, at_y, u, variance, r, L, white[:n])
    size = math.sqrt((white[0] ** 2 + white[1] ** 2 + white[2] ** 2) / n)
    # Huber's weight on the whole: as if all were less certain by that factor
    trust = outlier / size if outlier > 0.0 and size > outlier else 1.0
    for i in range(3):
        for j in range(n):
            for k in range(j):
                G[i, j] -= G[i, k] * L[j, k]
            G[i, j] /= L[j, j]
    for i in range(3):
        for j in range(n):
            pose[i] += trust * G[i, j] * white[j]
            for k in range(3):
                P[i, k] -= trust * G[i, j] * G[k, j]
    return log_det


@compiled
def _whiten(
    G: NDArray[np.float64],
    at_x: float,
    at_y: float,
    u: NDArray[np.float64],
    variance: NDArray[np.float64],
    r: NDArray[np.float64],
    L: NDArray[np.float64],
    white: NDArray[np.float64],
) -> float:
    """Make L and L^-1 r from P H^T, as many rows as `white` has; return log det (L L^T)."""
    log_det = 0.0
    for j in range(len(white)):
        lean = -at_y if j == 0 else at_x
        for k in range(j + 1):
            # S = H P H^T + R, row by row of H
            S = G[j, k] + lean * G[2, k] + variance[2] * u[j] * u[k] if j < 2 else G[2, k]
            if j == k:
                S += variance[0] if j < 2 else variance[1]
            for i in range(k):
                S -= L[j, i] * L[k, i]
            L[j, k] = math.sqrt(S) if j == k else S / L[k, k]
        white[j] = r[j]
        for k in range(j):
            white[j] -= L[j, k] * white[k]
        white[j] /= L[j, j]
        log_det += 2.0 * math.log(L[j, j])
    return log_det
