"""Scans of a lidar that turns while the robot drives, as seen from one place.

A turn takes 0.05 to 0.2 s. In that time a robot at 1 rad/s turns by up to ten degrees, which shears
what it sees. Each beam is measured from where the lidar was at its time; its end is the same point
in the world wherever it is seen from, so the scan is told as from the place of its last beam. Small
errors of the odometry do not count: it has a fraction of a second to be wrong in.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan

Floats: TypeAlias = NDArray[np.float64]
Motion: TypeAlias = Callable[[int], SE2 | None]
"""Returns `base` at a time [ns] in a frame that stands still; None: not known."""

_KNOTS: Final = 9
"""Number of poses between which the path during a sweep is taken as straight."""


def unwound(scan: RangeScan, motion: Motion) -> RangeScan:
    """Return a scan as from the place of its last beam, where that is known.

    A sweep whose motion is not known stays as it is.
    """
    count = len(scan.ranges_m)
    if scan.sweep_s == 0.0 or count < 2:
        return scan
    ahead = np.linspace(1.0, 0.0, count) if scan.sweep_s > 0.0 else np.linspace(0.0, 1.0, count)
    stamps_ns = scan.stamp_ns - np.round(ahead * abs(1e9 * scan.sweep_s)).astype(np.int64)
    angles, ranges = from_last_place(
        stamps_ns, scan.angles_rad, scan.ranges_m, (scan.x_m, scan.y_m), motion
    )
    return replace(scan, angles_rad=angles, ranges_m=ranges, sweep_s=0.0)


def from_last_place(
    stamps_ns: NDArray[np.int64],
    angles: Floats,
    ranges: Floats,
    mount: tuple[float, float],
    motion: Motion,
) -> tuple[Floats, Floats]:
    """Return directions in `base` and ranges of beams as from the place of the latest.

    Parameters
    ----------
    stamps_ns
        Time of each beam, (n,) [ns], in either order.
    angles, ranges
        Directions in `base` at that time, (n,) [rad]; ranges, (n,) [m], of which those that are not
        finite only turn.
    mount
        The lidar in `base`, x and y [m].
    motion
        Path of the robot.
    """
    knots_ns = np.linspace(stamps_ns.min(), stamps_ns.max(), _KNOTS)
    poses = [motion(int(each)) for each in knots_ns]
    last = poses[-1]
    known = [pose for pose in poses if pose is not None]
    if last is None or len(known) < _KNOTS:
        return angles, ranges
    moves = [last.inverse() @ pose for pose in known]
    x, y, theta = (
        np.interp(stamps_ns, knots_ns, each)
        for each in np.array([(move.x_m, move.y_m, move.theta_rad) for move in moves]).T
    )
    mount_x, mount_y = mount
    is_point = np.isfinite(ranges)
    away = np.where(is_point, ranges, 0.0)
    seen_x = mount_x + away * np.cos(angles)
    seen_y = mount_y + away * np.sin(angles)
    from_x = x + np.cos(theta) * seen_x - np.sin(theta) * seen_y - mount_x
    from_y = y + np.sin(theta) * seen_x + np.cos(theta) * seen_y - mount_y
    return (
        np.where(is_point, _beside(angles, np.arctan2(from_y, from_x)), angles + theta),
        np.where(is_point, np.hypot(from_x, from_y), ranges),
    )


def _beside(angles: Floats, wrapped: Floats) -> Floats:
    """Return angles in the turn that others, nearly the same, are in."""
    result: Floats = angles + np.angle(np.exp(1j * (wrapped - angles)))
    return result


def unwound_view(view: RangeScan, motion: Motion) -> RangeScan:
    """Return a view of several lidars, none of which was moved yet, as at its time."""
    now = motion(view.stamp_ns)
    if now is None:
        return view
    others = [
        unwound(each, motion).moved(now.inverse() @ then)
        for each in view.others
        if (then := motion(each.stamp_ns)) is not None
    ]
    return replace(unwound(view, motion), others=tuple(others))
