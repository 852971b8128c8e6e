"""Whether two scans can be of one place: what one sees, the other must not have looked through.

A point of one scan, put into the other, lies on the echo of the beam in its direction (agrees),
behind it (hidden, which says nothing), or well before it: the beam went through it (contradicts).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from robotctl.compiled import compiled
from robotctl.estimation.slam.front_end.surface import RANGE_LIMIT_M, Floats
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan

_SECTORS: Final = 720
_NEAR_M: Final = 0.15
_NEAR: Final = 0.02
"""A point is on an echo within this distance, and this share of its range."""
_CLEAR_M: Final = 0.35


@dataclass(frozen=True, slots=True, eq=False)
class ScanView:
    """Ranges by direction from the lidar, as a table.

    Parameters
    ----------
    x_m, y_m
        The lidar in `base` [m].
    nearest, farthest
        Ranges around each of `_SECTORS` directions, (n,) [m]; 0 where nothing is known.
    """

    x_m: float
    y_m: float
    nearest: Floats
    farthest: Floats


def view_of(scan: RangeScan) -> ScanView:
    """Return the view of a scan; beams without an echo or a reading count as unknown."""
    nearest, farthest = np.full(_SECTORS, np.inf), np.zeros(_SECTORS)
    limit_m = min(scan.max_range_m, RANGE_LIMIT_M)
    hit = np.isfinite(scan.ranges_m) & (scan.ranges_m < limit_m)
    step_rad = 0.0
    if len(scan.angles_rad) > 1:
        step_rad = float(np.median(np.abs(np.diff(scan.angles_rad))))
    _fill(
        scan.angles_rad[hit],
        scan.ranges_m[hit],
        0.75 * min(step_rad, 0.1) * _SECTORS / (2.0 * np.pi),
        nearest,
        farthest,
    )
    return ScanView(scan.x_m, scan.y_m, nearest, farthest)


@compiled
def _fill(angles: Floats, ranges: Floats, reach: float, nearest: Floats, farthest: Floats) -> None:
    """Enter each beam into the sectors that it covers."""
    for k in range(len(angles)):
        middle = angles[k] * _SECTORS / (2.0 * np.pi)
        for sector in range(int(np.floor(middle - reach)), int(np.floor(middle + reach)) + 1):
            at = sector % _SECTORS
            nearest[at] = min(nearest[at], ranges[k])
            farthest[at] = max(farthest[at], ranges[k])


@dataclass(frozen=True, slots=True)
class Agreement:
    """Agreement of a view with points, as shares of all of them.

    Parameters
    ----------
    agrees, contradicts
        Shares of the points on an echo, and of those a beam went through.
    """

    agrees: float
    contradicts: float

    @property
    def of_seen(self) -> float:
        """Share that agrees of those that say something; 0 if none does."""
        seen = self.agrees + self.contradicts
        return self.agrees / seen if seen > 0.0 else 0.0


def agreement(view: ScanView, points: Floats, weights: Floats, pose: SE2) -> Agreement:
    """Return what a view says of points (n, 2) in a frame whose pose in the view's `base` is given."""  # noqa: E501
    agrees, contradicts = _compare(
        view.x_m, view.y_m, view.nearest, view.farthest, points, weights,
        np.array([pose.x_m, pose.y_m, pose.theta_rad]),
    )  # fmt: skip
    return Agreement(agrees, contradicts)


@compiled
def _compare(
    x_m: float, y_m: float, nearest: Floats, farthest: Floats, points: Floats, weights: Floats,
    pose: Floats,
) -> tuple[float, float]:  # fmt: skip
    c, s = np.cos(pose[2]), np.sin(pose[2])
    agrees = contradicts = 0.0
    for k in range(len(points)):
        x = pose[0] + c * points[k, 0] - s * points[k, 1] - x_m
        y = pose[1] + s * points[k, 0] + c * points[k, 1] - y_m
        distance = np.hypot(x, y)
        sector = int(np.floor(np.arctan2(y, x) * _SECTORS / (2.0 * np.pi))) % _SECTORS
        if farthest[sector] == 0.0:
            continue
        near = _NEAR_M + _NEAR * distance
        if nearest[sector] - near <= distance <= farthest[sector] + near:
            agrees += weights[k]
        elif distance < nearest[sector] - _CLEAR_M - _NEAR * distance:
            contradicts += weights[k]
    total = max(weights.sum(), 1e-9)
    return agrees / total, contradicts / total
