"""Upright cylinders in a lidar scan: landmarks without a name.

The defaults are those of the arena of Brenner's lecture on SLAM: cylinders that look 0.08 m wide
and count 0.09 m behind their surface.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robotctl.model.sensors.range_scan import RangeScan


@dataclass(frozen=True, slots=True)
class CylinderConfig:
    """Criteria for a cylinder.

    Parameters
    ----------
    diameter_m
        Of the cylinders [m], > 0.
    behind_m
        Distance of the landmark behind the mean of the ranges [m], >= 0; pi/8 diameters where it is
        the axis of a round cylinder.
    jump_m
        Minimum distance before its background [m], > 0.
    beams
        Minimum number of beams that hit it, > 0.
    least_width, greatest_width
        Its width in the scan, in diameters, 0 < least < greatest.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    diameter_m: float = 0.08
    behind_m: float = 0.09
    jump_m: float = 0.1
    beams: int = 4
    least_width: float = 0.5
    greatest_width: float = 1.6

    def __post_init__(self) -> None:
        if not 0.0 <= self.behind_m < math.inf:
            raise ValueError(f"behind_m: {self.behind_m} found, a finite number >= 0 allowed")
        for key in ("diameter_m", "jump_m", "beams", "least_width"):
            value = getattr(self, key)
            if not 0.0 < value < math.inf:
                raise ValueError(f"{key}: {value} found, a finite number > 0 allowed")
        if not self.least_width < self.greatest_width < math.inf:
            raise ValueError(
                f"greatest_width: {self.greatest_width} found, a finite number above least_width "
                f"allowed ({self.least_width})"
            )


def cylinders(scan: RangeScan, config: CylinderConfig) -> NDArray[np.float64]:
    """Return range [m] and bearing [rad] of the axes of cylinders in `base`, (k, 2).

    A cylinder is a run of beams that begins with a jump towards the sensor and ends with one away
    from it, as wide as a cylinder.

    Parameters
    ----------
    scan
        Beams without a valid reading are passed over; they must be in the order of their angles.
    config
        What counts as a cylinder.
    """
    valid = ~np.isnan(scan.ranges_m)
    ranges = np.minimum(scan.ranges_m[valid], scan.max_range_m)
    angles = scan.angles_rad[valid]
    jumps = np.diff(ranges)
    edges = np.flatnonzero(np.abs(jumps) > config.jump_m)
    if len(edges) < 2:
        return np.empty((0, 2))
    first, last = edges[:-1] + 1, edges[1:]
    count = last - first + 1
    sums = np.concatenate([[0.0], np.cumsum(ranges)])
    mean = (sums[last + 1] - sums[first]) / count
    width = mean * (angles[last] - angles[first]) * count / np.maximum(count - 1, 1)
    diameters = width / config.diameter_m
    found = (jumps[edges[:-1]] < 0.0) & (jumps[edges[1:]] > 0.0) & (count >= config.beams)
    found &= (diameters >= config.least_width) & (diameters <= config.greatest_width)
    axis = mean[found] + config.behind_m
    middle = 0.5 * (angles[first] + angles[last])[found]
    x, y = scan.x_m + axis * np.cos(middle), scan.y_m + axis * np.sin(middle)
    return np.stack([np.hypot(x, y), np.arctan2(y, x)], axis=1)
