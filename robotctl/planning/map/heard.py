"""People whom a robot hears coming along its own line, by the sonars that look ahead and back."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount

RADIUS_M: Final = 0.25
"""Radius of a person who is only heard [m]."""
_LEAST_M_S: Final = 0.3
"""Minimum closing speed of a walker [m/s]: walls passed at an angle seem slower."""
_WITHIN_RAD: Final = math.radians(20.0)
"""Angle off straight ahead, or back, within which a sonar looks along the robot's line."""


def heard_walkers(
    pose: SE2,
    mounts: Sequence[SonarMount],
    approaches: Sequence[tuple[float, float]],
    explained: Callable[[NDArray[np.float64]], NDArray[np.bool_]],
) -> NDArray[np.float64]:
    """Return people who come along the robot's line, (k, 5), as `LocalSituation.moving`.

    A sonar tells neither their side nor their direction: each is taken to be on its axis, and to
    walk along it.

    Parameters
    ----------
    pose
        `base` in `world`.
    mounts, approaches
        The sonars, and of each the range [m] and closing speed [m/s] of what comes nearer to it by
        itself; below 0: goes away.
    explained
        Which points (n, 2) of `world` are near walls of the map, (n,).
    """
    rows = []
    for mount, (range_m, closing_m_s) in zip(mounts, approaches, strict=True):
        off_rad = abs(wrap_angle(mount.heading_rad))
        if closing_m_s < _LEAST_M_S or _WITHIN_RAD < off_rad < math.pi - _WITHIN_RAD:
            continue
        sonar = pose @ SE2(mount.x_m, mount.y_m, mount.heading_rad)
        if explained(np.array([sonar.apply(range_m, 0.0)]))[0]:
            continue
        c, s = math.cos(sonar.theta_rad), math.sin(sonar.theta_rad)
        x_m, y_m = sonar.apply(range_m + RADIUS_M, 0.0)
        rows.append((x_m, y_m, -closing_m_s * c, -closing_m_s * s, RADIUS_M))
    return np.array(rows).reshape(-1, 5)
