"""Points in space seen from a pose: their coordinates in its frame, or their distance."""

from __future__ import annotations

from typing import Final

import numpy as np

from native_kernels.compiled import compiled
from robotctl.estimation.slam.factors.rotations import matrix, unrotate
from robotctl.estimation.slam.graph.factor import FactorKind
from robotctl.estimation.slam.graph.variables import POINT3, SE3, Floats


@compiled
def _linearise_seen(
    a: Floats, b: Floats, z: Floats, residuals: Floats, by_a: Floats, by_b: Floats
) -> None:
    """Fill residuals (n, 3) and Jacobians of points b (n, 3) in the frames of poses a (n, 7)."""
    turned, p = np.empty((3, 3)), np.empty(3)
    by_a[:] = 0.0
    for k in range(len(z)):
        unrotate(a[k, 3:], b[k], a[k, :3], p)
        matrix(a[k, 3:], turned)
        for i in range(3):
            residuals[k, i] = p[i] - z[k, i]
            by_a[k, i, i] = -1.0
            for j in range(3):
                by_b[k, i, j] = turned[j, i]
        by_a[k, 0, 4], by_a[k, 0, 5] = -p[2], p[1]
        by_a[k, 1, 3], by_a[k, 1, 5] = p[2], -p[0]
        by_a[k, 2, 3], by_a[k, 2, 4] = -p[1], p[0]


@compiled
def _residual_seen(a: Floats, b: Floats, z: Floats) -> Floats:
    result = np.empty((len(z), 3))
    for k in range(len(z)):
        unrotate(a[k, 3:], b[k], a[k, :3], result[k])
        for i in range(3):
            result[k, i] -= z[k, i]
    return result


def _residual_range(a: Floats, b: Floats, z: Floats) -> Floats:
    distance: Floats = np.linalg.norm(b - a[:, :3], axis=1, keepdims=True)
    return distance - z


SEEN_3D: Final = FactorKind(
    "point seen in space", (SE3, POINT3), 3, 3, _residual_seen, _linearise_seen
)
RANGE_3D: Final = FactorKind("range in space", (SE3, POINT3), 1, 1, _residual_range)
