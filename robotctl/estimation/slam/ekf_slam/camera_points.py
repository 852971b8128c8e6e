"""Points seen by a camera that is calibrated on the way: its errors are part of the robot's state.

The robot's state is that of `landmarks.models`, whose `sightings` is the model.
"""

from __future__ import annotations

import math
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.landmarks.models import sightings
from robotctl.estimation.slam.ekf_slam.features import FeatureKind

Array: TypeAlias = NDArray[np.float64]

_STEPS: Final = 10
"""Steps of Newton's method that invert the camera's model; each doubles the digits."""


def _place(x: Array, z: Array) -> Array:
    """Return where a point is that is seen at a range [m] and bearing [rad], (2,) [m]."""
    direction = x[2] + z[1]
    y: Array = x[:2] + z[0] * np.array([math.cos(direction), math.sin(direction)])
    for _ in range(_STEPS):
        expected, _, by_point = sightings(x, y[np.newaxis])
        y = y + np.linalg.solve(by_point[0], CAMERA_POINT.residual(z[np.newaxis], expected)[0])
    return y


CAMERA_POINT: Final = FeatureKind("point", sightings, _place, (False, True))
"""Points (x, y) [m] of `world`, seen at range [m] and bearing [rad] as the camera reports them."""
