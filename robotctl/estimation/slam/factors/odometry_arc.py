"""Odometry of wheels: an arc of so many metres and radians.

The residual is Log(X_i^-1 X_j) - (distance, 0, turn): along the arc, across it [m], and turn
[rad], so that slip of the three has its own variances.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from robotctl.estimation.slam.factors.between import wrapped
from robotctl.estimation.slam.factors.landmarks import seen
from robotctl.estimation.slam.graph.factor import FactorKind
from robotctl.estimation.slam.graph.variables import SE2, Floats

_SMALL_RAD: Final = 1e-4


def _residual(a: Floats, b: Floats, z: Floats) -> Floats:
    """Return residuals (n, 3) of measurements (n, 2): distance [m], turn [rad]."""
    slip = wrapped(b[:, 2] - a[:, 2] - z[:, 1])
    half = 0.5 * (z[:, 1] + slip)  # of the turn, which may be more than half a circle
    is_small = np.abs(half) < _SMALL_RAD
    safe = np.where(is_small, 1.0, half)
    h = np.where(is_small, 1.0 - half**2 / 3.0, safe / np.tan(safe))
    x, y = seen(a, b[:, :2]).T
    return np.column_stack([h * x + half * y - z[:, 0], h * y - half * x, slip])


ODOMETRY_ARC: Final = FactorKind("odometry arc", (SE2, SE2), 2, 3, _residual)
