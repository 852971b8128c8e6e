"""A point of the floor in the picture of a camera on the robot."""

from __future__ import annotations

from typing import Final

import numpy as np

from robotctl.estimation.slam.factors.landmarks import seen
from robotctl.estimation.slam.factors.rotations import unrotate
from robotctl.estimation.slam.graph.factor import FactorKind
from robotctl.estimation.slam.graph.variables import POINT2, SE2, Floats

_NEAREST_M: Final = 1e-3
"""Depth that a point at or behind the camera counts with, where a picture has none."""


def _residual(a: Floats, b: Floats, z: Floats) -> Floats:
    """Return residuals (n, 2) in normalised image coordinates (x right, y down, depth 1).

    Measurements (n, 9) are x, y of the undistorted point and `T_base_camera`: position [m] and
    quaternion x, y, z, w, with z along the optical axis; the floor is z = 0 of `base`.
    """
    at_base = np.column_stack([seen(a, b), np.zeros(len(a))])
    at_camera = np.empty((len(a), 3))
    for point, measured, row in zip(at_base, z, at_camera, strict=True):
        unrotate(measured[5:], point, measured[2:5], row)
    return at_camera[:, :2] / np.maximum(at_camera[:, 2:], _NEAREST_M) - z[:, :2]


GROUND_POINT: Final = FactorKind(
    "point of the floor in a picture", (SE2, POINT2), 9, 2, _residual, quaternion=5
)
