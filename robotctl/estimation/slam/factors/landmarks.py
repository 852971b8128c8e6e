"""Points in the plane seen from a pose: by range and bearing, one of them, or both coordinates.

The bearing is the point's direction from the heading, counter-clockwise; a residual is prediction
minus measurement.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from native_kernels.compiled import compiled
from robotctl.estimation.slam.factors.between import wrapped
from robotctl.estimation.slam.graph.factor import FactorKind
from robotctl.estimation.slam.graph.variables import POINT2, SE2, Floats, wrap

_NEAR_M: Final = 1e-9
"""A point nearer than that has no direction; the Jacobians stay finite."""


@compiled
def _linearise(
    a: Floats, b: Floats, z: Floats, residuals: Floats, by_a: Floats, by_b: Floats,
    distance: int, bearing: int,
) -> None:  # fmt: skip
    """Fill the rows `distance` and `bearing` of residuals and Jacobians; a row < 0 is left out."""
    for k in range(len(z)):
        c, s = np.cos(a[k, 2]), np.sin(a[k, 2])
        dx, dy = b[k, 0] - a[k, 0], b[k, 1] - a[k, 1]
        x, y = c * dx + s * dy, c * dy - s * dx
        r = max(np.hypot(x, y), _NEAR_M)
        if distance >= 0:
            i, u, v = distance, x / r, y / r
            residuals[k, i] = r - z[k, i]
            by_a[k, i, 0], by_a[k, i, 1], by_a[k, i, 2] = -u, -v, 0.0
            by_b[k, i, 0], by_b[k, i, 1] = u * c - v * s, u * s + v * c
        if bearing >= 0:
            i, u, v = bearing, -y / (r * r), x / (r * r)
            residuals[k, i] = wrap(np.arctan2(y, x) - z[k, i])
            by_a[k, i, 0], by_a[k, i, 1], by_a[k, i, 2] = -u, -v, -1.0
            by_b[k, i, 0], by_b[k, i, 1] = u * c - v * s, u * s + v * c


def _both(a: Floats, b: Floats, z: Floats, r: Floats, by_a: Floats, by_b: Floats) -> None:
    _linearise(a, b, z, r, by_a, by_b, 0, 1)


def _direction(a: Floats, b: Floats, z: Floats, r: Floats, by_a: Floats, by_b: Floats) -> None:
    _linearise(a, b, z, r, by_a, by_b, -1, 0)


def _distance(a: Floats, b: Floats, z: Floats, r: Floats, by_a: Floats, by_b: Floats) -> None:
    _linearise(a, b, z, r, by_a, by_b, 0, -1)


@compiled
def _linearise_seen(
    a: Floats, b: Floats, z: Floats, residuals: Floats, by_a: Floats, by_b: Floats
) -> None:
    """Fill residuals (n, 2) and Jacobians of points b (n, 2) in the frames of poses a (n, 3)."""
    for k in range(len(z)):
        c, s = np.cos(a[k, 2]), np.sin(a[k, 2])
        dx, dy = b[k, 0] - a[k, 0], b[k, 1] - a[k, 1]
        x, y = c * dx + s * dy, c * dy - s * dx
        residuals[k, 0], residuals[k, 1] = x - z[k, 0], y - z[k, 1]
        by_a[k, 0, 0], by_a[k, 0, 1], by_a[k, 0, 2] = -1.0, 0.0, y
        by_a[k, 1, 0], by_a[k, 1, 1], by_a[k, 1, 2] = 0.0, -1.0, -x
        by_b[k, 0, 0], by_b[k, 0, 1], by_b[k, 1, 0], by_b[k, 1, 1] = c, s, -s, c


def seen(a: Floats, b: Floats) -> Floats:
    """Return points b (n, 2) in the frames of poses a (n, 3), (n, 2) [m]."""
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    dx, dy = (b - a[:, :2]).T
    return np.column_stack([c * dx + s * dy, c * dy - s * dx])


def _residual_range(a: Floats, b: Floats, z: Floats) -> Floats:
    at = seen(a, b)
    return np.hypot(at[:, :1], at[:, 1:]) - z


def _residual_bearing(a: Floats, b: Floats, z: Floats) -> Floats:
    at = seen(a, b)
    return wrapped(np.arctan2(at[:, 1:], at[:, :1]) - z)


def _residual_both(a: Floats, b: Floats, z: Floats) -> Floats:
    return np.hstack([_residual_range(a, b, z[:, :1]), _residual_bearing(a, b, z[:, 1:])])


def _residual_seen(a: Floats, b: Floats, z: Floats) -> Floats:
    return seen(a, b) - z


RANGE_BEARING: Final = FactorKind("range and bearing", (SE2, POINT2), 2, 2, _residual_both, _both)
BEARING: Final = FactorKind("bearing", (SE2, POINT2), 1, 1, _residual_bearing, _direction)
RANGE: Final = FactorKind("range", (SE2, POINT2), 1, 1, _residual_range, _distance)
SEEN_2D: Final = FactorKind("point seen", (SE2, POINT2), 2, 2, _residual_seen, _linearise_seen)
