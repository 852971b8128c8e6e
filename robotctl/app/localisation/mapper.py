"""The map that grows while the robot drives."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from robotctl.app.localisation.localiser import LocaliserInput
from robotctl.estimation.grid.occupancy_grid import OccupancyGrid
from robotctl.estimation.odometry.odometry_history import OdometryHistory
from robotctl.messages.estimation import LiveMap, LocalisationState
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.sensors.sonar import SonarMount, SonarReading

_LEAST_M: Final = 0.05
_LEAST_RAD: Final = 0.05
"""A robot at rest sees the same again, which is no new evidence."""
_VAGUE_M: Final = 0.1
"""Maximum standard deviation of a camera's range in the map [m]."""
_OCCUPIED_ABOVE: Final = 0.85
"""Live, walls are seen many times: one or two echoes are not yet one."""


class Mapper:
    """Adds scans and sonar ranges to an occupancy grid at the estimated poses.

    With a lidar the sonars are left out: their cones only blur what it sees.

    Parameters
    ----------
    grid
        The map, in `world`.
    mounts
        The sonars, in the order of the ranges.
    history
        Of the odometry.
    """

    def __init__(
        self, grid: OccupancyGrid, mounts: Sequence[SonarMount], history: OdometryHistory
    ) -> None:
        self.grid = grid
        self._mounts = tuple(mounts)
        self._history = history
        self._scanned: SE2 | None = None
        self._viewed: SE2 | None = None
        self._heard: list[SE2 | None] = [None] * len(self._mounts)
        """Where the odometry was when each sonar was last taken in."""

    def step(self, localisation: LocalisationState | None, seen: LocaliserInput) -> None:
        """Add new scans while the robot is localised; without a localiser, always."""
        T_world_odom = SE2()
        if localisation is not None:
            if localisation.status is not LocalisationStatus.LOCALISED:
                return
            T_world_odom = localisation.T_world_odom
        for scan in seen.scans:
            if self._scanned is None and self._history.at(scan.stamp_ns) is not None:
                self.grid.reset()
            self._scanned = self._add_scan(T_world_odom, scan, self._scanned)
        for view in seen.views:
            self._viewed = self._add_scan(T_world_odom, _sure(view), self._viewed)
        if self._scanned is None:
            for reading in seen.sonars:
                self._add_sonars(T_world_odom, reading)

    def _add_scan(self, T_world_odom: SE2, scan: RangeScan, last: SE2 | None) -> SE2 | None:
        """Add a scan at its pose, unless `last` was there; return the last pose."""
        odometry = self._history.at(scan.stamp_ns)
        if odometry is None or not _moved(last, odometry):
            return last
        self.grid.update_scan(T_world_odom @ odometry, scan)
        return odometry

    def _add_sonars(self, T_world_odom: SE2, reading: SonarReading) -> None:
        """Add the range of each sonar that measured from a new place."""
        odometry = self._history.at(reading.stamp_ns)
        if odometry is None:
            return
        for index, (range_m, mount) in enumerate(zip(reading.ranges_m, self._mounts, strict=True)):
            if not math.isnan(range_m) and _moved(self._heard[index], odometry):
                self._heard[index] = odometry
                self.grid.update_sonar(T_world_odom @ odometry, mount, range_m)

    def live_map(self, now_ns: int) -> LiveMap | None:
        """Return the map for people and for the score; None if nothing has been seen yet."""
        if all(place is None for place in (self._scanned, self._viewed, *self._heard)):
            return None
        return live_map(self.grid.to_map(_OCCUPIED_ABOVE), now_ns)


def live_map(grid: GridMap, now_ns: int) -> LiveMap:
    """Return a map as a message."""
    rows, columns = grid.cells.shape
    return LiveMap(
        stamp_ns=now_ns,
        rows=rows,
        columns=columns,
        resolution_m=grid.resolution_m,
        x_m=grid.origin.x_m,
        y_m=grid.origin.y_m,
        cells=grid.cells.tobytes(),
        theta_rad=grid.origin.theta_rad,
    )


def _sure(view: RangeScan) -> RangeScan:
    """Return a view of the camera without the ranges that are too vague for a cell."""
    if view.sigmas_m is None:
        return view
    ranges = np.where(view.sigmas_m <= _VAGUE_M, view.ranges_m, np.nan)
    return replace(view, ranges_m=np.where(np.isinf(view.ranges_m), np.inf, ranges))


def _moved(before: SE2 | None, after: SE2) -> bool:
    """Say whether the robot moved enough to see something new; None: it has seen nothing yet."""
    if before is None:
        return True
    distance_m = math.hypot(after.x_m - before.x_m, after.y_m - before.y_m)
    return (
        distance_m >= _LEAST_M or abs(wrap_angle(after.theta_rad - before.theta_rad)) >= _LEAST_RAD
    )
