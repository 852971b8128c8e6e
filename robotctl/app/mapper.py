"""The map that grows while the robot drives."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from robotctl.app.odometry_history import OdometryHistory
from robotctl.estimation.occupancy_grid import OccupancyGrid
from robotctl.model.angles import wrap_angle
from robotctl.model.grid_map import GridMap
from robotctl.model.localisation import LocalisationStatus
from robotctl.model.range_scan import RangeScan
from robotctl.model.se2 import SE2
from robotctl.model.sonar import SonarMount
from robotctl.runtime.messages import ControlState, LiveMap, LocalisationState

_LEAST_M: Final = 0.05
_LEAST_RAD: Final = 0.05
"""A robot that stands sees the same again, which is no new evidence."""
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
        self._heard: list[tuple[int, SE2]] = [(0, SE2(math.inf, 0.0, 0.0))] * len(self._mounts)

    def step(
        self,
        control: ControlState,
        localisation: LocalisationState | None,
        scans: Sequence[RangeScan],
    ) -> None:
        """Add what is new, where the robot knows its place; `control` is the odometry's."""
        T_world_odom = SE2()
        if localisation is not None:
            if localisation.status is not LocalisationStatus.LOCALISED:
                return
            T_world_odom = SE2(localisation.x_m, localisation.y_m, localisation.theta_rad)
        for scan in scans:
            self._add_scan(T_world_odom, scan)
        if self._scanned is None:
            self._add_sonars(T_world_odom, control)

    def _add_scan(self, T_world_odom: SE2, scan: RangeScan) -> None:
        """Add a scan where it was taken."""
        odometry = self._history.at(scan.stamp_ns)
        if odometry is None:
            return
        if self._scanned is None:
            self.grid.reset()
        elif not _moved(self._scanned, odometry):
            return
        self._scanned = odometry
        self.grid.update_scan(T_world_odom @ odometry, scan)

    def _add_sonars(self, T_world_odom: SE2, control: ControlState) -> None:
        """Add each sonar's range that is new and from a new place."""
        readings = zip(control.sonar_stamp_ns, control.sonar_m, self._mounts, strict=True)
        for index, (stamp_ns, range_m, mount) in enumerate(readings):
            heard_ns, place = self._heard[index]
            odometry = self._history.at(stamp_ns)
            if stamp_ns <= heard_ns or odometry is None or not _moved(place, odometry):
                continue
            self._heard[index] = (stamp_ns, odometry)
            self.grid.update_sonar(T_world_odom @ odometry, mount, range_m)

    def live_map(self, now_ns: int) -> LiveMap | None:
        """Return the map for people and for the score; None where nothing was seen yet."""
        return None if self._nothing else live_map(self.grid.to_map(_OCCUPIED_ABOVE), now_ns)

    @property
    def _nothing(self) -> bool:
        return self._scanned is None and all(stamp_ns == 0 for stamp_ns, _ in self._heard)


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
    )


def _moved(before: SE2, after: SE2) -> bool:
    """Say whether the robot moved enough to see something new."""
    distance_m = math.hypot(after.x_m - before.x_m, after.y_m - before.y_m)
    return (
        distance_m >= _LEAST_M or abs(wrap_angle(after.theta_rad - before.theta_rad)) >= _LEAST_RAD
    )
