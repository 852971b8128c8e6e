"""Knowledge of a single variable: a prior, or an absolute position as of a GNSS."""

from __future__ import annotations

from typing import Final

import numpy as np

from robotctl.estimation.slam.factors.between import (
    linearise_2d,
    linearise_3d,
    residual_2d,
    residual_3d,
)
from robotctl.estimation.slam.factors.rotations import matrix
from robotctl.estimation.slam.graph.factor import FactorKind
from robotctl.estimation.slam.graph.variables import POINT2, POINT3, SE2, SE3, Floats


def _origins(z: Floats) -> Floats:
    """Return as many poses at the origin as there are measurements of poses."""
    origins = np.zeros_like(z)
    if z.shape[1] == SE3.size:
        origins[:, -1] = 1.0
    return origins


def _pose_2d(a: Floats, z: Floats, residuals: Floats, by_a: Floats) -> None:
    linearise_2d(_origins(z), a, z, residuals, np.empty_like(by_a), by_a)


def _pose_3d(a: Floats, z: Floats, residuals: Floats, by_a: Floats) -> None:
    linearise_3d(_origins(z), a, z, residuals, np.empty_like(by_a), by_a)


def _offset(a: Floats, z: Floats) -> Floats:
    return a[:, : z.shape[1]] - z


def _point(a: Floats, z: Floats, residuals: Floats, by_a: Floats) -> None:
    residuals[:] = a - z
    by_a[:] = np.eye(z.shape[1])


def _position_2d(a: Floats, z: Floats, residuals: Floats, by_a: Floats) -> None:
    residuals[:] = _offset(a, z)
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    by_a[:, 0, 0], by_a[:, 0, 1], by_a[:, 1, 0], by_a[:, 1, 1] = c, -s, s, c
    by_a[:, :, 2] = 0.0


def _position_3d(a: Floats, z: Floats, residuals: Floats, by_a: Floats) -> None:
    residuals[:] = _offset(a, z)
    by_a[:] = 0.0
    for pose, jacobian in zip(a, by_a, strict=True):
        matrix(pose[3:], jacobian)


PRIOR_2D: Final = FactorKind(
    "prior of a pose", (SE2,), 3, 3, lambda a, z: residual_2d(_origins(z), a, z), _pose_2d
)
PRIOR_3D: Final = FactorKind(
    "prior of a pose in space",
    (SE3,),
    7,
    6,
    lambda a, z: residual_3d(_origins(z), a, z),
    _pose_3d,
    quaternion=3,
)
PRIOR_POINT_2D: Final = FactorKind("prior of a point", (POINT2,), 2, 2, _offset, _point)
PRIOR_POINT_3D: Final = FactorKind("prior of a point in space", (POINT3,), 3, 3, _offset, _point)
POSITION_2D: Final = FactorKind("position", (SE2,), 2, 2, _offset, _position_2d)
POSITION_3D: Final = FactorKind("position in space", (SE3,), 3, 3, _offset, _position_3d)
