"""Visibility: which places a scan looks at, and how far along its path a robot sees."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan

_SHORT_M: Final = 0.1
"""A beam that ends this much before a place still sees it [m]: noise, and the cell of the path."""
_BESIDE: Final = 1.5
"""Greatest angle between a place and the nearest beam, in angles between beams."""


def sees(T_world_base: SE2, scan: RangeScan, places: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which places (n, 2) of `world` a scan, or one of its `others`, looks at, (n,).

    A place is seen where one of the two beams on both sides of it reaches it: a lost beam hides
    nothing, and neither does what is as thin.
    """
    seen = np.zeros(len(places), np.bool_)
    for each in (scan, *scan.others):
        order = np.argsort(each.angles_rad, kind="stable")
        angles, ranges_m = each.angles_rad[order], each.ranges_m[order]
        if len(angles) < 2:
            continue
        sensor = T_world_base @ SE2(each.x_m, each.y_m, 0.0)
        away = places - (sensor.x_m, sensor.y_m)
        bearings = np.arctan2(away[:, 1], away[:, 0]) - sensor.theta_rad
        bearings = angles[0] + (bearings - angles[0]) % math.tau
        after = np.searchsorted(angles, bearings) % len(angles)
        away_m = np.hypot(*away.T)
        spacing_rad = float(np.median(np.diff(angles)))
        for beam in (after - 1, after):
            off_rad = np.abs((bearings - angles[beam] + math.pi) % math.tau - math.pi)
            reaches_m = np.minimum(np.nan_to_num(ranges_m[beam], nan=0.0), each.max_range_m)
            seen |= (off_rad <= _BESIDE * spacing_rad) & (reaches_m + _SHORT_M >= away_m)
    return seen


def seen_along(
    T_world_base: SE2,
    scan: RangeScan,
    path: NDArray[np.float64],
    half_width_m: float,
    reach_m: float,
) -> float:
    """Return the way of a body on a path to where a scan sees less than its width [m].

    inf: all of the path is seen.

    Parameters
    ----------
    T_world_base
        Of the scan.
    scan
        The scan.
    path
        Poses (n, 3) of `world` from the robot on.
    half_width_m
        Half the width of the body.
    reach_m
        Way of the body's foremost point ahead of `base`: so far the path is the robot's own place.
    """
    ways_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path[:, :2], axis=0).T))])
    left = np.column_stack([-np.sin(path[:, 2]), np.cos(path[:, 2])])
    hidden = np.zeros(len(path), np.bool_)
    for beside_m in (-half_width_m, 0.0, half_width_m):
        hidden |= ~sees(T_world_base, scan, path[:, :2] + beside_m * left)
    hidden &= ways_m > reach_m
    return float(ways_m[np.argmax(hidden)]) - reach_m if hidden.any() else math.inf
