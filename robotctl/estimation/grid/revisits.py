"""Check of poses by revisits: if they are right, scans of two visits to a place agree.

With poses from odometry, which drift, a place seems to have moved when the robot returns; with
corrected poses it is where it was.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.points import moved
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan

_LATER_M: Final = 20.0
"""Minimum distance travelled between two visits [m]."""
_NEAR_M, _NEAR_RAD = 1.0, 0.6
"""Maximum difference between two poses that count as the same place [m], [rad]."""
_AGREES_M: Final = 0.2
"""Distance within which echoes of two visits are of the same thing [m]."""
_SEEN_M: Final = 15.0
"""Range beyond which echoes move too much with a small turn [m]."""
_TRIED, _PAIRS, _LEAST_PAIRS, _LEAST_ECHOES = 400, 60, 3, 20
"""Poses tried, pairs compared, and the least pairs and echoes that say anything."""


def revisit_agreement(scans: Sequence[RangeScan], poses: Sequence[SE2]) -> float | None:
    """Return the share of a later visit's echoes that lie near echoes of the earlier visit.

    Median over pairs of visits, 0 to 1: above 0.6 for right poses, below 0.2 for drifting ones.
    None if the robot hardly ever returns to a place.
    """
    rows = np.array([(pose.x_m, pose.y_m, pose.theta_rad) for pose in poses]).reshape(-1, 3)
    shares = []
    for former, later in _visits(rows)[:_PAIRS]:
        before, after = (_echoes(scans[index], rows[index]) for index in (former, later))
        if min(len(before), len(after)) >= _LEAST_ECHOES:
            shares.append(_share_near(before, after))
    return float(np.median(shares)) if len(shares) >= _LEAST_PAIRS else None


def _share_near(before: NDArray[np.float64], after: NDArray[np.float64]) -> float:
    """Return the share of the points `after` that lie near one of `before`, (n, 2) each [m]."""
    nearest = [np.hypot(*(before - point).T).min() for point in after]
    return float(np.mean(np.array(nearest) < _AGREES_M))


def _visits(poses: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Return pairs of poses (earlier visit, later visit) at the same place."""
    if len(poses) < 2:
        return []
    way_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])
    pairs = []
    for former in np.unique(np.linspace(0, len(poses) - 1, _TRIED).astype(int)).tolist():
        away_m = np.hypot(*(poses[:, :2] - poses[former, :2]).T)
        near = np.flatnonzero(away_m <= _NEAR_M)
        turned = np.remainder(poses[near, 2] - poses[former, 2] + math.pi, math.tau) - math.pi
        later = near[(way_m[near] - way_m[former] > _LATER_M) & (np.abs(turned) < _NEAR_RAD)]
        if len(later):
            pairs.append((former, int(later.min())))
    step = max(1, len(pairs) // _PAIRS)
    return pairs[::step]


def _echoes(scan: RangeScan, pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the positions of a scan's echoes in world, (n, 2) [m]."""
    points = scan.points_base()
    points = points[np.hypot(points[:, 0], points[:, 1]) < _SEEN_M]
    return moved(SE2(*pose.tolist()), points)
