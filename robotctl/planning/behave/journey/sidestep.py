"""Paths to a place beside the robot, without turning round and without a search."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from robotctl.model.geometry.se2 import SE2
from robotctl.planning.path.global_planning.plan import Plan

_SPACING_M: Final = 0.05
_TURNED: Final = 0.6
"""Slope from which on the robot does not head along the lane [tan]."""
_STRAIGHT: Final = 0.1
"""Slope up to which it is straight on [tan]: the rest is noise."""


def sidestep(pose: SE2, there: SE2, radius_m: float, length_m: float) -> Plan | None:
    """Return the path that shifts a robot to another pose of about the same heading.

    In the frame of that pose it leads straight on, and at last along a cubic, y(x), whose ends have
    both headings: driven ahead or in reverse, as the pose lies.

    Parameters
    ----------
    pose, there
        Begin and end, `base` in `world`.
    radius_m
        Smallest circle that it may bend by.
    length_m
        Length of that last part; all of the way if that is shorter, or does not begin straight.

    Returns
    -------
    Plan | None
        None if it would bend more, or the headings differ by more than half a radian.
    """
    begin = there.inverse() @ pose
    x0, y0, slope = begin.x_m, begin.y_m, math.tan(begin.theta_rad)
    if abs(x0) < _SPACING_M or math.cos(begin.theta_rad) <= 0.0 or abs(slope) > _TURNED:
        return None
    x = np.linspace(x0, 0.0, 2 + int(abs(x0) / _SPACING_M))
    if abs(slope) < _STRAIGHT and abs(x0) > length_m:
        x0, slope = math.copysign(length_m, x0), 0.0
    # y = a x^2 + b x^3, from y(x0) and y'(x0); y and y' are 0 at x = 0.
    a = (3.0 * y0 - slope * x0) / x0**2
    b = (slope * x0 - 2.0 * y0) / x0**3
    bent = np.clip(x, -abs(x0), abs(x0))
    y, slopes = (a + b * bent) * bent**2, (2.0 * a + 3.0 * b * bent) * bent
    bends = np.abs(2.0 * a + 6.0 * b * bent) / (1.0 + slopes**2) ** 1.5
    if bends.max() * radius_m > 1.0 or np.abs(slopes).max() > _TURNED:
        return None
    c, s = math.cos(there.theta_rad), math.sin(there.theta_rad)
    headings = np.arctan(slopes) + there.theta_rad
    poses = np.column_stack([there.x_m + c * x - s * y, there.y_m + s * x + c * y, headings])
    way_m = float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum())
    return Plan(poses, way_m, 0, np.full(len(x) - 1, x0 > 0.0))
