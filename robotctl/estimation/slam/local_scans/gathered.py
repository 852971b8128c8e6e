"""Local scans: what a sensor that sees little at once has seen along a stretch.

Echoes lie in the frame of the odometry, which over so short a stretch is good to a centimetre or
two. They are put together as seen from the middle of the stretch, so that a place looks the same
in both directions.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from robotctl.model.geometry.points import moved
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import RecordedScan
from robotctl.model.sensors.range_scan import RangeScan

TURN_M: Final = 0.2
"""Distance that a turn of one radian counts as [m]: turning shows something new as well."""
_SECTORS: Final = 180
_EVERY_M: Final = 0.25
_TOGETHER_M: Final = 0.15
"""Maximum distance between echoes of one surface in a sector [m]."""
_COMPANY: Final = 3
"""Minimum number of echoes around one, itself included: a single one may be anything."""


class _Stop(NamedTuple):
    stamp_ns: int
    way_m: float
    odometry: SE2


class GatheredScans:
    """Gathers echoes along the odometry.

    Parameters
    ----------
    stretch_m
        Length of the stretch that a scan is made of, with turns by `TURN_M` [m].
    max_range_m
        Echoes farther from the middle are left out [m].
    """

    def __init__(self, stretch_m: float, max_range_m: float) -> None:
        self._half_m = 0.5 * stretch_m
        self._max_range_m = max_range_m
        self._echoes: deque[tuple[float, NDArray[np.float64]]] = deque()
        self._stops: deque[_Stop] = deque()
        self._last: SE2 | None = None
        self._stop_m = -math.inf
        self.way_m = 0.0
        """Distance travelled so far, turns included [m]."""

    def move(self, stamp_ns: int, odometry: SE2) -> None:
        """Move to a pose of `base` in `odom`."""
        if self._last is not None:
            step = self._last.inverse() @ odometry
            self.way_m += math.hypot(step.x_m, step.y_m) + TURN_M * abs(step.theta_rad)
        self._last = odometry
        if self.way_m >= self._stop_m + _EVERY_M:
            self._stop_m = self.way_m
            self._stops.append(_Stop(stamp_ns, self.way_m, odometry))

    def see(self, way_m: float, points_odom: NDArray[np.float64]) -> None:
        """Add echoes (n, 2) in `odom` that were seen at a travelled distance; n may be 0."""
        if len(points_odom):
            self._echoes.append((way_m, points_odom))

    def take(self, seen_m: float) -> list[RecordedScan]:
        """Return the scans that are complete, once all up to a travelled distance is added."""
        scans = []
        while self._stops and self._stops[0].way_m + self._half_m <= seen_m:
            stop = self._stops.popleft()
            while self._echoes and self._echoes[0][0] < stop.way_m - self._half_m:
                self._echoes.popleft()
            seen = [points for way_m, points in self._echoes if way_m <= stop.way_m + self._half_m]
            points = moved(stop.odometry.inverse(), np.concatenate([np.empty((0, 2)), *seen]))
            scan = scan_of_points(points, stop.stamp_ns, self._max_range_m)
            scans.append(RecordedScan(scan, stop.odometry))
        return scans


def scan_of_points(points: NDArray[np.float64], stamp_ns: int, max_range_m: float) -> RangeScan:
    """Return what is nearest of points (n, 2) in each of 180 directions; nan where nothing is.

    Points without two others near them are left out.
    """
    angles = (np.arange(_SECTORS) + 0.5) * 2.0 * math.pi / _SECTORS - math.pi
    points = points[_in_company(points)]
    distances = np.hypot(points[:, 0], points[:, 1])
    points, distances = points[distances < max_range_m], distances[distances < max_range_m]
    sectors = np.arctan2(points[:, 1], points[:, 0]) + math.pi
    rows = np.minimum((sectors * _SECTORS / (2.0 * math.pi)).astype(np.intp), _SECTORS - 1)
    nearest = np.full(_SECTORS, np.inf)
    np.minimum.at(nearest, rows, distances)
    is_front = distances <= nearest[rows] + _TOGETHER_M
    count = np.bincount(rows[is_front], minlength=_SECTORS)
    total = np.bincount(rows[is_front], distances[is_front], minlength=_SECTORS)
    ranges = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return RangeScan(stamp_ns, angles, ranges, max_range_m)


def _in_company(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which points have others in their square of `_TOGETHER_M` or around it, (n,)."""
    cells = np.floor(points / _TOGETHER_M).astype(np.intp)
    cells -= cells.min(axis=0, initial=0) - 1
    counts = np.zeros(cells.max(axis=0, initial=1) + 2, np.intp)
    np.add.at(counts, (cells[:, 0], cells[:, 1]), 1)
    around = sliding_window_view(counts, (3, 3)).sum(axis=(2, 3))
    result: NDArray[np.bool_] = around[cells[:, 0] - 1, cells[:, 1] - 1] >= _COMPANY
    return result
