"""Points seen by a camera that is calibrated on the way: its errors are part of the robot's state.

The robot's state is that of `landmarks.models`, of which this is `sighting` for many points.
"""

from __future__ import annotations

import math
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.compiled import compiled
from robotctl.estimation.landmarks.models import S
from robotctl.estimation.slam.ekf_slam.features import FeatureKind

Array: TypeAlias = NDArray[np.float64]

_OFFSET, _SCALE = int(S.RANGE_OFFSET), int(S.RANGE_SCALE)
_DEPTH, _AXIS = int(S.DEPTH_SHARE), int(S.AXIS)
_TURNED, _TURN_SCALE = int(S.BEARING_OFFSET), int(S.BEARING_SCALE)
_ARM_X, _ARM_Y, _WANDER = int(S.ARM_X), int(S.ARM_Y), int(S.WANDER)
_STEPS: Final = 10
"""Steps of Newton's method that invert the camera's model; each doubles the digits."""


@compiled
def _seen(x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Return expected range [m] and bearing [rad] of points (k, 2), and their Jacobians."""
    count = len(y)
    z, by_point = np.empty((count, 2)), np.empty((count, 2, 2))
    by_robot = np.zeros((count, 2, len(x)))
    c, s = math.cos(x[2]), math.sin(x[2])
    scale, turn_scale = 1.0 + x[_SCALE], 1.0 + x[_TURN_SCALE]
    for k in range(count):
        dx, dy = y[k, 0] - x[0], y[k, 1] - x[1]
        bx, by = c * dx + s * dy, -s * dx + c * dy
        qx, qy = bx - x[_ARM_X], by - x[_ARM_Y]
        r, phi = math.hypot(qx, qy), math.atan2(qy, qx)
        off = phi - x[_AXIS]
        lost = 1.0 - math.cos(off)
        shape = 1.0 - x[_DEPTH] * lost
        turn = -scale * r * x[_DEPTH] * math.sin(off)
        z[k, 0] = x[_OFFSET] + scale * shape * r
        z[k, 1] = x[_TURNED] + x[_WANDER] + turn_scale * phi
        H = by_robot[k]
        # by the point's place in the camera, then by what moves that
        ux, uy = qx / r, qy / r
        h = np.array(
            [
                [scale * shape * ux - turn * uy / r, scale * shape * uy + turn * ux / r],
                [-turn_scale * uy / r, turn_scale * ux / r],
            ]
        )
        for q in range(2):
            H[q, 0] = -h[q, 0] * c + h[q, 1] * s
            H[q, 1] = -h[q, 0] * s - h[q, 1] * c
            H[q, 2] = h[q, 0] * by - h[q, 1] * bx
            H[q, _ARM_X], H[q, _ARM_Y] = -h[q, 0], -h[q, 1]
            by_point[k, q, 0], by_point[k, q, 1] = -H[q, 0], -H[q, 1]
        H[0, _OFFSET] = 1.0
        H[0, _SCALE] = r * shape
        H[0, _DEPTH] = -scale * r * lost
        H[0, _AXIS] = -turn
        H[1, _TURNED] = H[1, _WANDER] = 1.0
        H[1, _TURN_SCALE] = phi
    return z, by_robot, by_point


def _place(x: Array, z: Array) -> Array:
    """Return where a point is that is seen at a range [m] and bearing [rad], (2,) [m]."""
    direction = x[2] + z[1]
    y: Array = x[:2] + z[0] * np.array([math.cos(direction), math.sin(direction)])
    for _ in range(_STEPS):
        expected, _, by_point = _seen(x, y[np.newaxis])
        y = y + np.linalg.solve(by_point[0], CAMERA_POINT.residual(z[np.newaxis], expected)[0])
    return y


CAMERA_POINT: Final = FeatureKind("point", _seen, _place, (False, True))
"""Points (x, y) [m] of `world`, seen at range [m] and bearing [rad] as the camera reports them."""
