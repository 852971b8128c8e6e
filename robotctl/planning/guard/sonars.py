"""Directions of the sonars."""

from __future__ import annotations

import math
from collections.abc import Sequence

from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.sensors.sonar import SonarMount

DIRECTIONS_RAD = {
    "front": 0.0,
    "front_left": 0.25 * math.pi,
    "front_right": -0.25 * math.pi,
    "left": 0.5 * math.pi,
    "right": -0.5 * math.pi,
    "rear": math.pi,
}
_WITHIN_RAD = math.radians(20.0)


def sonar_towards(mounts: Sequence[SonarMount], direction: str) -> int | None:
    """Return the index of the sonar that looks to the front, left, right or rear.

    The one nearest to that direction; None if none lies within 20 degrees of it.
    """
    wanted = DIRECTIONS_RAD[direction]
    best, best_off = None, _WITHIN_RAD
    for index, mount in enumerate(mounts):
        off = abs(wrap_angle(mount.heading_rad - wanted))
        if off <= best_off and (best is None or off < best_off):
            best, best_off = index, off
    return best


def sonar_directions(mounts: Sequence[SonarMount]) -> frozenset[str]:
    """Return the directions that have a sonar."""
    return frozenset(d for d in DIRECTIONS_RAD if sonar_towards(mounts, d) is not None)
