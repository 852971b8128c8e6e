"""Least squares on small graphs as a textbook has it: dense, with differences for derivatives.

Residuals are written down anew, with homogeneous matrices, and fixed variables are no unknowns.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from robotctl.estimation.slam.graph.variables import SE2, SE3


def matrix_of(value):
    """Return the homogeneous matrix of a pose."""
    d = 2 if len(value) == 3 else 3
    T = np.eye(d + 1)
    T[:d, d] = value[:d]
    if d == 2:
        c, s = np.cos(value[2]), np.sin(value[2])
        T[:2, :2] = [[c, -s], [s, c]]
    else:
        x, y, z, w = value[3:]
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        T[:3, :3] = np.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross
    return T


def inverse(T):
    """Return the inverse of a homogeneous matrix."""
    d = len(T) - 1
    result = np.eye(d + 1)
    result[:d, :d] = T[:d, :d].T
    result[:d, d] = -T[:d, :d].T @ T[:d, d]
    return result


def coordinates(T):
    """Return what g2o takes for the residual of a pose; in space for less than half a turn."""
    if len(T) == 3:
        return np.array([T[0, 2], T[1, 2], np.arctan2(T[1, 0], T[0, 0])])
    w = 0.5 * np.sqrt(1.0 + np.trace(T[:3, :3]))
    vector = np.array([T[2, 1] - T[1, 2], T[0, 2] - T[2, 0], T[1, 0] - T[0, 1]]) / (4.0 * w)
    return np.concatenate([T[:3, 3], vector])


def local(pose, point):
    """Return a point in the frame of a pose."""
    T = matrix_of(pose)
    d = len(T) - 1
    return T[:d, :d].T @ (point - T[:d, d])


def angle(radians):
    return np.arctan2(np.sin(radians), np.cos(radians))


def polar(pose, point):
    x, y = local(pose, point)
    return np.array([np.hypot(x, y), np.arctan2(y, x)])


def between(a, b, z):
    return coordinates(inverse(matrix_of(z)) @ inverse(matrix_of(a)) @ matrix_of(b))


def prior(a, z):
    return coordinates(inverse(matrix_of(z)) @ matrix_of(a))


def range_bearing(a, b, z):
    off = polar(a, b) - z
    return np.array([off[0], angle(off[1])])


RESIDUALS = {
    "between_2d": between,
    "between_3d": between,
    "prior_2d": prior,
    "prior_3d": prior,
    "position_2d": lambda a, z: a[:2] - z,
    "position_3d": lambda a, z: a[:3] - z,
    "prior_point_2d": lambda a, z: a - z,
    "prior_point_3d": lambda a, z: a - z,
    "seen_2d": lambda a, b, z: local(a, b) - z,
    "seen_3d": lambda a, b, z: local(a, b) - z,
    "range_bearing": range_bearing,
    "bearing": lambda a, b, z: angle(polar(a, b)[1:] - z),
    "range": lambda a, b, z: polar(a, b)[:1] - z,
}


def moved(kind, value, step):
    """Return a value moved by an increment: in the frame of a pose."""
    if kind is SE2:
        T = matrix_of(value)
        return np.append(value[:2] + T[:2, :2] @ step[:2], value[2] + step[2])
    if kind is SE3:
        R = Rotation.from_quat(value[3:])
        turned = R * Rotation.from_rotvec(step[3:])
        return np.concatenate([value[:3] + R.apply(step[:3]), turned.as_quat()])
    return value + step


class Dense:
    """A graph as lists: factors (name, ends, measurement, information) with ends (kind, row)."""

    def __init__(self, factors, fixed):
        self.factors = [
            (RESIDUALS[name], ends, z, square_root(information))
            for name, ends, z, information in factors
        ]
        self.fixed = fixed

    def residuals(self, values):
        parts = [self.residual(each, values) for each in self.factors]
        return np.concatenate(parts) if parts else np.empty(0)

    def residual(self, factor, values):
        residual, ends, z, root = factor
        return root @ residual(*(values[kind][row] for kind, row in ends), z)

    def chi2(self, values):
        return float(np.sum(self.residuals(values) ** 2))

    def jacobian(self, values):
        columns = []
        begins = np.cumsum([0, *(len(root) for *_, root in self.factors)])
        for kind, each in values.items():
            for row in range(len(each)):
                if (kind, row) in self.fixed:
                    continue
                for k in range(kind.dof):
                    ends, column = [], np.zeros(begins[-1])
                    for sign in (1.0, -1.0):
                        step = np.zeros(kind.dof)
                        step[k] = sign * 1e-6
                        ends.append({**values, kind: each.copy()})
                        ends[-1][kind][row] = moved(kind, each[row], step)
                    for at, factor in zip(begins, self.factors, strict=False):
                        if (kind, row) in factor[1]:
                            r, s = (self.residual(factor, there) for there in ends)
                            column[at : at + len(r)] = (r - s) / 2e-6
                    columns.append(column)
        return np.array(columns).T if columns else np.empty((begins[-1], 0))

    def stepped(self, values, step):
        result, at = {kind: each.copy() for kind, each in values.items()}, 0
        for kind, each in values.items():
            for row in range(len(each)):
                if (kind, row) not in self.fixed:
                    result[kind][row] = moved(kind, each[row], step[at : at + kind.dof])
                    at += kind.dof
        return result

    def optimum(self, values):
        """Return values of least chi2 near some, by damped Gauss-Newton."""
        values = {kind: each.copy() for kind, each in values.items()}
        damping, chi2 = 1e-6, self.chi2(values)
        for _ in range(100):
            J, r = self.jacobian(values), self.residuals(values)
            H = J.T @ J
            step = -np.linalg.lstsq(H + damping * np.eye(len(H)), J.T @ r, rcond=None)[0]
            there = self.stepped(values, step)
            after = self.chi2(there)
            if after < chi2:
                done = chi2 - after < 1e-12 * chi2
                values, chi2, damping = there, after, max(0.1 * damping, 1e-12)
                if done:
                    break
            elif damping > 1e6:
                break
            else:
                damping = 10.0 * damping
        return values, chi2


def square_root(information):
    """Return a matrix whose square, in the sense of R^T R, is the information."""
    squares, vectors = np.linalg.eigh(information)
    return np.sqrt(np.maximum(squares, 0.0))[:, None] * vectors.T
