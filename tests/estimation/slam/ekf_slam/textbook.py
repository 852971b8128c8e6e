"""EKF-SLAM as textbooks write it, with whole matrices, and drives among landmarks to try it on."""

from __future__ import annotations

import itertools
import math

import numpy as np

from robotctl.model.drives.motion import arc
from robotctl.model.geometry.se2 import SE2

R = np.diag([0.05**2, 0.02**2])


def wrapped(angle):
    return (angle + math.pi) % math.tau - math.pi


class DenseSlam:
    """Robot (x, y, theta) and points; every matrix in full (Probabilistic Robotics, 10.2)."""

    def __init__(self, x, P):
        self.x, self.P = np.array(x, dtype=float), np.array(P, dtype=float)

    def predict(self, x_v, F, Q):
        n = len(self.x)
        whole, noise = np.eye(n), np.zeros((n, n))
        whole[:3, :3], noise[:3, :3] = F, Q
        self.x[:3] = x_v
        self.P = whole @ self.P @ whole.T + noise

    def jacobian(self, which):
        H, dx, dy = np.zeros((2, len(self.x))), *(self._feature(which) - self.x[:2])
        q = dx * dx + dy * dy
        r = math.sqrt(q)
        H[:, :3] = [[-dx / r, -dy / r, 0.0], [dy / q, -dx / q, -1.0]]
        at = 3 + 2 * which
        H[:, at : at + 2] = [[dx / r, dy / r], [-dy / q, dx / q]]
        return H, np.array([r, math.atan2(dy, dx) - self.x[2]])

    def update(self, which, z, noise=R):
        """Take measurements (m, 2) of features together, in Joseph form."""
        rows = [self.jacobian(each) for each in which]
        H = np.concatenate([row[0] for row in rows])
        off = np.concatenate([measured - row[1] for measured, row in zip(z, rows, strict=True)])
        off[1::2] = wrapped(off[1::2])
        whole = np.kron(np.eye(len(which)), noise)
        S = H @ self.P @ H.T + whole
        K = self.P @ H.T @ np.linalg.inv(S)
        self.x = self.x + K @ off
        left = np.eye(len(self.x)) - K @ H
        self.P = left @ self.P @ left.T + K @ whole @ K.T
        return off @ np.linalg.inv(S) @ off

    def add(self, z, noise=R):
        r, direction = z[0], self.x[2] + z[1]
        c, s = math.cos(direction), math.sin(direction)
        n = len(self.x)
        J = np.vstack([np.eye(n), np.zeros((2, n))])
        J[n:, :3] = [[1.0, 0.0, -r * s], [0.0, 1.0, r * c]]
        by_z = np.zeros((n + 2, 2))
        by_z[n:] = [[c, -r * s], [s, r * c]]
        self.x = np.append(self.x, [self.x[0] + r * c, self.x[1] + r * s])
        self.P = J @ self.P @ J.T + by_z @ noise @ by_z.T

    def remove(self, which):
        kept = np.arange(len(self.x) - 2)
        if which < len(kept[3:]) // 2:  # the last feature takes the number
            kept[3 + 2 * which : 5 + 2 * which] = [len(kept), len(kept) + 1]
        self.x, self.P = self.x[kept], self.P[np.ix_(kept, kept)]

    def _feature(self, which):
        return self.x[3 + 2 * which : 5 + 2 * which]


def sighted(pose, points):
    """Return range and bearing of points from a pose, (k, 2)."""
    dx, dy = (points - [pose.x_m, pose.y_m]).T
    return np.stack([np.hypot(dx, dy), wrapped(np.arctan2(dy, dx) - pose.theta_rad)], axis=1)


def drive(rng, steps, points, noise, reach_m=6.0, speed_m=0.25):
    """Yield odometry (distance, turn), the true pose, and who is seen how, for a winding drive."""
    pose = SE2()
    for k in range(steps):
        d, a = speed_m, 0.12 * math.sin(0.05 * k) + 0.05
        moved = d + noise.e_m_per_sqrt_m * math.sqrt(d) * rng.standard_normal()
        f, g = noise.f_rad_per_sqrt_m, noise.g_rad_per_sqrt_rad
        turned = a + math.sqrt(f * f * d + g * g * abs(a)) * rng.standard_normal()
        pose = arc(pose, moved, turned)
        z = sighted(pose, points)
        near = np.flatnonzero(z[:, 0] < reach_m)
        yield d, a, pose, near, z[near] + rng.standard_normal((len(near), 2)) @ np.sqrt(R)


def best_pairs(innovations, G, noise, gate):
    """Return the largest jointly compatible set of pairs, the best of those, by trying all.

    `gate` is the limit of k dimensions. Every pair must be compatible alone, and every set of the
    first pairs as well, as the search along a tree of measurements has it.
    """
    m, k = innovations.shape[:2]

    def distance(pairs):
        rows = [2 * i + r for _, i in pairs for r in (0, 1)]
        S = G[np.ix_(rows, rows)] + np.kron(np.eye(len(pairs)), noise)
        off = np.concatenate([innovations[a, i] for a, i in pairs])
        return off @ np.linalg.solve(S, off)

    best, found = (0, 0.0), (-1,) * m
    for choice in itertools.product(range(-1, k), repeat=m):
        pairs = [(a, i) for a, i in enumerate(choice) if i >= 0]
        if not pairs or len({i for _, i in pairs}) < len(pairs):
            continue
        if any(distance([pair]) > gate(2) for pair in pairs):
            continue
        if any(distance(pairs[:p]) > gate(2 * p) for p in range(1, len(pairs) + 1)):
            continue
        rank = (len(pairs), -distance(pairs))
        if rank > best:
            best, found = rank, choice
    return np.array(found)
