"""Kinds of variables: poses and points, in the plane and in space.

An increment of a pose is taken in its own frame: `t + R(t) rho`, `R Exp(phi)`, with rho [m] first
and phi [rad] after it. It is the same to first order as `T Exp(rho, phi)`, and cheaper.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled

Floats: TypeAlias = NDArray[np.float64]

LARGEST: Final = 1e30
"""Largest size of a number in a graph: products of a few of them stay finite."""


@dataclass(frozen=True, slots=True, eq=False)
class VariableKind:
    """One kind of variables.

    Parameters
    ----------
    name
        For messages: "pose", "point".
    size
        Numbers of one value.
    dof
        Numbers of one increment.
    positions
        How many of the first numbers are a position [m].
    identity
        A value that stands for "unknown", (size,).
    retract
        Maps values (n, size) and increments (n, dof) to values.
    """

    name: str
    size: int
    dof: int
    positions: int
    identity: tuple[float, ...]
    retract: Callable[[Floats, Floats], Floats]

    def __repr__(self) -> str:
        """Return a name that tells kinds apart."""
        return f"{self.name} of {self.size} numbers"

    @property
    def is_pose(self) -> bool:
        """Whether it has an orientation."""
        return self.dof > self.positions


@compiled
def wrap(angle: float) -> float:
    """Return the angle in [-pi, pi) [rad]."""
    turns: float = np.floor((angle + np.pi) / (2.0 * np.pi))
    return angle - 2.0 * np.pi * turns


@compiled
def retract_se2(values: Floats, increments: Floats) -> Floats:
    """Return poses (n, 3): x, y [m], theta [rad], moved by increments (n, 3)."""
    result = np.empty_like(values)
    for k in range(len(values)):
        c, s = np.cos(values[k, 2]), np.sin(values[k, 2])
        result[k, 0] = values[k, 0] + c * increments[k, 0] - s * increments[k, 1]
        result[k, 1] = values[k, 1] + s * increments[k, 0] + c * increments[k, 1]
        result[k, 2] = wrap(values[k, 2] + increments[k, 2])
    return result


def _add(values: Floats, increments: Floats) -> Floats:
    """Return points moved by increments, both (n, dof)."""
    return values + increments


@compiled
def retract_se3(values: Floats, increments: Floats) -> Floats:
    """Return poses (n, 7): x, y, z [m], unit quaternion x, y, z, w, moved by increments (n, 6)."""
    result = np.empty_like(values)
    for k in range(len(values)):
        x, y, z, w = values[k, 3], values[k, 4], values[k, 5], values[k, 6]
        a, b, c = increments[k, 0], increments[k, 1], increments[k, 2]
        # R v = v + 2 u x (u x v + w v)
        p, q, r = y * c - z * b + w * a, z * a - x * c + w * b, x * b - y * a + w * c
        result[k, 0] = values[k, 0] + a + 2.0 * (y * r - z * q)
        result[k, 1] = values[k, 1] + b + 2.0 * (z * p - x * r)
        result[k, 2] = values[k, 2] + c + 2.0 * (x * q - y * p)
        a, b, c = increments[k, 3], increments[k, 4], increments[k, 5]
        angle = np.sqrt(a * a + b * b + c * c)
        factor = 0.5 - angle * angle / 48.0 if angle < 1e-3 else np.sin(0.5 * angle) / angle
        a, b, c, d = a * factor, b * factor, c * factor, np.cos(0.5 * angle)
        p, q, r, t = (
            w * a + x * d + y * c - z * b,
            w * b + y * d + z * a - x * c,
            w * c + z * d + x * b - y * a,
            w * d - x * a - y * b - z * c,
        )
        norm = np.sqrt(p * p + q * q + r * r + t * t)
        result[k, 3], result[k, 4] = p / norm, q / norm
        result[k, 5], result[k, 6] = r / norm, t / norm
    return result


SE2: Final = VariableKind("pose", 3, 3, 2, (0.0, 0.0, 0.0), retract_se2)
POINT2: Final = VariableKind("point", 2, 2, 2, (0.0, 0.0), _add)
SE3: Final = VariableKind("pose", 7, 6, 3, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0), retract_se3)
POINT3: Final = VariableKind("point", 3, 3, 3, (0.0, 0.0, 0.0), _add)
KINDS: Final[tuple[VariableKind, ...]] = (SE2, POINT2, SE3, POINT3)
