"""Kinds of features: how the robot measures one, and where one is that it measures.

A feature has two numbers, and so has its measurement. The Jacobians of a new feature follow from
those of its measurement z = h(x_v, y) by the implicit function theorem:
dy = (dh/dy)^-1 (dz - dh/dx_v dx_v). So a kind is two functions.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NoReturn, TypeAlias

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FeatureKind:
    """Model of a kind of feature for EKF-SLAM.

    Parameters
    ----------
    name
        For people and reports.
    expected
        From the robot's state (nv,) and k features (k, 2) to the expected measurements (k, 2),
        and their Jacobians by the robot's state (k, 2, nv) and by the feature (k, 2, 2).
    initial
        From the robot's state (nv,) and a measurement (2,) to the feature (2,).
    angles
        Which of the two numbers of a measurement are angles [rad].
    turns
        Whether a feature is a place, (x, y) in `world`, and so turns with the whole about its
        origin.
    """

    name: str
    expected: Callable[[Array, Array], tuple[Array, Array, Array]]
    initial: Callable[[Array, Array], Array]
    angles: tuple[bool, bool]
    turns: bool = True

    def residual(self, z: Array, expected: Array) -> Array:
        """Return measured minus expected, (m, 2), angles on the circle."""
        return _difference(z, expected, *self.angles)


@compiled
def _difference(z: Array, expected: Array, first: bool, second: bool) -> Array:
    """Return z - expected, (m, 2), wrapped where it is an angle."""
    off = z - expected
    for column in range(2):
        if (first, second)[column]:
            for a in range(len(off)):
                off[a, column] -= math.tau * round(off[a, column] / math.tau)
    return off


@compiled
def _sighted(x_v: Array, y: Array) -> tuple[Array, Array, Array]:
    """Return expected range [m] and bearing [rad] of points (k, 2), and their Jacobians."""
    count = len(y)
    z, by_feature = np.empty((count, 2)), np.empty((count, 2, 2))
    by_robot = np.zeros((count, 2, len(x_v)))
    for k in range(count):
        dx, dy = y[k, 0] - x_v[0], y[k, 1] - x_v[1]
        square = dx * dx + dy * dy
        r = math.sqrt(square)
        turned = math.atan2(dy, dx) - x_v[2]
        z[k, 0] = r
        z[k, 1] = turned - math.tau * round(turned / math.tau)
        by_feature[k, 0, 0], by_feature[k, 0, 1] = dx / r, dy / r
        by_feature[k, 1, 0], by_feature[k, 1, 1] = -dy / square, dx / square
        by_robot[k, :, 0], by_robot[k, :, 1] = -by_feature[k, :, 0], -by_feature[k, :, 1]
        by_robot[k, 1, 2] = -1.0
    return z, by_robot, by_feature


@compiled
def _point(x_v: Array, z: Array) -> Array:
    """Return where a point is that was seen at a range [m] and bearing [rad], (2,) [m]."""
    direction = x_v[2] + z[1]
    return np.array([x_v[0] + z[0] * math.cos(direction), x_v[1] + z[0] * math.sin(direction)])


POINT: Final = FeatureKind("point", _sighted, _point, (False, True))
"""Points (x, y) [m] of `world`, seen at range [m] and bearing [rad] of `base`.

Source: Thrun, Burgard, Fox: Probabilistic Robotics, section 10.2; not defined on the point itself.
"""


@compiled
def _in_base(x_v: Array, y: Array) -> tuple[Array, Array, Array]:
    """Return points (k, 2) in the frame of the robot [m], and their Jacobians."""
    count = len(y)
    z, by_feature = np.empty((count, 2)), np.empty((count, 2, 2))
    by_robot = np.zeros((count, 2, len(x_v)))
    c, s = math.cos(x_v[2]), math.sin(x_v[2])
    for k in range(count):
        dx, dy = y[k, 0] - x_v[0], y[k, 1] - x_v[1]
        z[k, 0], z[k, 1] = c * dx + s * dy, c * dy - s * dx
        by_feature[k, 0, 0], by_feature[k, 0, 1] = c, s
        by_feature[k, 1, 0], by_feature[k, 1, 1] = -s, c
        by_robot[k, :, 0], by_robot[k, :, 1] = -by_feature[k, :, 0], -by_feature[k, :, 1]
        by_robot[k, 0, 2], by_robot[k, 1, 2] = z[k, 1], -z[k, 0]
    return z, by_robot, by_feature


@compiled
def _in_world(x_v: Array, z: Array) -> Array:
    """Return where a point of the robot's frame is, (2,) [m]."""
    c, s = math.cos(x_v[2]), math.sin(x_v[2])
    return np.array([x_v[0] + c * z[0] - s * z[1], x_v[1] + s * z[0] + c * z[1]])


SEEN_POINT: Final = FeatureKind("point", _in_base, _in_world, (False, False))
"""Points (x, y) [m] of `world`, of which a sensor tells x and y in `base` [m]."""


@compiled
def _faced(x_v: Array, y: Array) -> tuple[Array, Array, Array]:
    """Return lines (k, 2) in the frame of the robot, direction [rad] and distance [m]."""
    count = len(y)
    z, by_feature = np.empty((count, 2)), np.zeros((count, 2, 2))
    by_robot = np.zeros((count, 2, len(x_v)))
    for k in range(count):
        c, s = math.cos(y[k, 0]), math.sin(y[k, 0])
        turned = y[k, 0] - x_v[2]
        z[k, 0] = turned - math.tau * round(turned / math.tau)
        z[k, 1] = y[k, 1] - c * x_v[0] - s * x_v[1]
        by_feature[k, 0, 0] = by_feature[k, 1, 1] = 1.0
        by_feature[k, 1, 0] = s * x_v[0] - c * x_v[1]
        by_robot[k, 0, 2] = -1.0
        by_robot[k, 1, 0], by_robot[k, 1, 1] = -c, -s
    return z, by_robot, by_feature


@compiled
def _line(x_v: Array, z: Array) -> Array:
    """Return the line of `world` that the robot sees in a direction [rad], at a distance [m]."""
    alpha = x_v[2] + z[0]
    return np.array([alpha, z[1] + math.cos(alpha) * x_v[0] + math.sin(alpha) * x_v[1]])


LINE: Final = FeatureKind("line", _faced, _line, (True, False), turns=False)
"""Lines (alpha, r), x cos(alpha) + y sin(alpha) = r in `world` [rad], [m], as a scan shows them in
`base` (`find_lines`). The normal points away from the side that is seen, so r may be negative, and
two sides of a wall are two lines.

A turn of the whole about its origin adds to alpha and leaves r, wherever the line is: these errors
need not turn with the heading, and are those of the invariant filter as they stand.
Source: Castellanos, Tardós: Mobile Robot Localization and Map Building, Kluwer 1999, chapter 2."""


def _unmeasured(*_: Array) -> NoReturn:
    raise NotImplementedError("past poses are not measured")


PLACE: Final = FeatureKind("place", _unmeasured, _unmeasured, (False, False))
HEADING: Final = FeatureKind("heading", _unmeasured, _unmeasured, (False, False), turns=False)
"""A past pose (`EkfSlam.remember`): (x, y) [m], and (theta, 0) [rad]."""
