"""Whether two scans can be of one place: what one sees, the other must not have looked through.

A point of one scan, put into the other, lies on the echo of the beam in its direction (agrees),
behind it (hidden, which says nothing), or well before it: the beam went through it (contradicts).
The two sides of a wall are not the same: one that faces away is hidden where the echo is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from native_kernels.compiled import compiled
from robotctl.estimation.slam.front_end.surface import RANGE_LIMIT_M, Floats, Surface, beam_step_rad
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan

_SECTORS: Final = 720
_NEAR_M: Final = 0.15
_NEAR: Final = 0.02
"""A point is on an echo within this distance, and this share of its range."""
_CLEAR_M: Final = 0.35
_FROM_BEHIND: Final = -0.2
"""Cosine of the angle between a point's normal and the beam towards the lidar, below which it faces
away; those of walls along the beam are not sure."""


@dataclass(frozen=True, slots=True, eq=False)
class ScanView:
    """Ranges by direction from each lidar, as tables.

    Parameters
    ----------
    sensors
        The lidars in `base`, (s, 2) [m].
    nearest, farthest
        Ranges around each of `_SECTORS` directions, (s, n) [m]; 0 where nothing is known.
    """

    sensors: Floats
    nearest: Floats
    farthest: Floats

    def reaches(self, x_m: float, y_m: float) -> bool:
        """Return whether no echo stands between a lidar and a point of `base`."""
        for (from_x, from_y), nearest, farthest in zip(
            self.sensors.tolist(), self.nearest, self.farthest, strict=True
        ):
            x, y = x_m - from_x, y_m - from_y
            sector = int(np.floor(np.arctan2(y, x) * _SECTORS / (2.0 * np.pi))) % _SECTORS
            if farthest[sector] != 0.0 and np.hypot(x, y) >= nearest[sector]:
                return False
        return True


def view_of(scan: RangeScan) -> ScanView:
    """Return the view of a scan; beams without an echo or a reading count as unknown."""
    tables = [_table(each) for each in scan.parts]
    return ScanView(
        np.array([(each.x_m, each.y_m) for each in scan.parts]),
        np.stack([nearest for nearest, _ in tables]),
        np.stack([farthest for _, farthest in tables]),
    )


def _table(scan: RangeScan) -> tuple[Floats, Floats]:
    """Return the nearest and the farthest range of one lidar by direction."""
    nearest, farthest = np.full(_SECTORS, np.inf), np.zeros(_SECTORS)
    limit_m = min(scan.max_range_m, RANGE_LIMIT_M)
    hit = np.isfinite(scan.ranges_m) & (scan.ranges_m < limit_m)
    reach = 0.75 * min(beam_step_rad(scan.angles_rad), 0.1) * _SECTORS / (2.0 * np.pi)
    _fill(scan.angles_rad[hit], scan.ranges_m[hit], reach, nearest, farthest)
    return nearest, farthest


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


def agreement(view: ScanView, surface: Surface, pose: SE2) -> Agreement:
    """Return what a view says of a surface in a frame whose pose in the view's `base` is given."""
    agrees, contradicts = _compare(
        view.sensors, view.nearest, view.farthest, surface.points, surface.normals,
        surface.weights, np.array([pose.x_m, pose.y_m, pose.theta_rad]),
    )  # fmt: skip
    return Agreement(agrees, contradicts)


@compiled
def _compare(
    sensors: Floats, nearest: Floats, farthest: Floats, points: Floats, normals: Floats,
    weights: Floats, pose: Floats,
) -> tuple[float, float]:  # fmt: skip
    """Sum up the points that a lidar has an echo at, and those that one looks through, if none."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    agrees = contradicts = 0.0
    for k in range(len(points)):
        is_through = False
        nx, ny = c * normals[k, 0] - s * normals[k, 1], s * normals[k, 0] + c * normals[k, 1]
        for i in range(len(sensors)):
            x = pose[0] + c * points[k, 0] - s * points[k, 1] - sensors[i, 0]
            y = pose[1] + s * points[k, 0] + c * points[k, 1] - sensors[i, 1]
            distance = np.hypot(x, y)
            sector = int(np.floor(np.arctan2(y, x) * _SECTORS / (2.0 * np.pi))) % _SECTORS
            if farthest[i, sector] == 0.0:
                continue
            near = _NEAR_M + _NEAR * distance
            if nearest[i, sector] - near <= distance <= farthest[i, sector] + near:
                if -(nx * x + ny * y) < _FROM_BEHIND * distance:
                    continue
                agrees += weights[k]
                is_through = False
                break
            if distance < nearest[i, sector] - _CLEAR_M - _NEAR * distance:
                is_through = True
        if is_through:
            contradicts += weights[k]
    total = max(weights.sum(), 1e-9)
    return agrees / total, contradicts / total
