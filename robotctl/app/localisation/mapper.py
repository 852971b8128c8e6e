"""The map that grows while the robot drives."""

from __future__ import annotations

import math
from collections.abc import Hashable
from typing import Any

from robotctl.app.localisation.localiser import LocaliserInput
from robotctl.estimation.grid.config import OccupancyGridConfig
from robotctl.estimation.grid.occupancy_grid import OccupancyGrid
from robotctl.estimation.odometry.odometry_history import OdometryHistory
from robotctl.estimation.sensors.registry import load_sensors
from robotctl.estimation.sensors.sensor import Detail, Measured, SensedRobot, Sensor
from robotctl.messages.estimation import LiveMap, LocalisationState, SlamGraph
from robotctl.messages.map_message import map_message
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap


class Mapper:
    """Adds what the sensors measure to an occupancy grid, at the estimated poses.

    Parameters
    ----------
    grid
        The map, in `world`.
    robot
        Mountings and settings of its sensors.
    history
        History of the odometry.
    """

    def __init__(self, grid: OccupancyGrid, robot: SensedRobot, history: OdometryHistory) -> None:
        self.grid = grid
        self._robot = robot
        self._sensors = load_sensors()
        self._history = history
        self._last: dict[Hashable, SE2] = {}
        """Odometry when something was last added, by the keys of `Sensor.cells`."""
        self._is_fine = False
        """Whether a sensor that draws finely has been there."""

    def step(self, localisation: LocalisationState | None, seen: LocaliserInput) -> None:
        """Add new scans while the robot is localised; without a localiser, always."""
        if seen.is_paused:
            return
        T_world_odom = SE2()
        if localisation is not None:
            if localisation.status is not LocalisationStatus.LOCALISED:
                return
            T_world_odom = localisation.T_world_odom
        for name, sensor in self._sensors.items():
            if sensor.detail is Detail.COARSE and self._is_fine:
                continue
            for each in seen.measured.get(name, ()):
                odometry = self._history.at(each.stamp_ns)
                if odometry is not None:
                    self._add(sensor, each, odometry, T_world_odom)

    def _add(
        self, sensor: Sensor[Any], measured: Measured, odometry: SE2, T_world_odom: SE2
    ) -> None:
        """Add what a sensor measured from a new place."""
        if sensor.detail is Detail.FINE and not self._is_fine:
            self._is_fine = True
            self.grid.reset()
        for key, update in sensor.cells(measured, self._robot):
            if _moved(self._last.get(key), odometry, self.grid.config):
                self._last[key] = odometry
                update(self.grid, T_world_odom @ odometry)

    def settled_map(self) -> GridMap | None:
        """None: the map is for people and for the score; plans are made on the robot's own."""

    def pictures(self, now_ns: int) -> list[LiveMap | SlamGraph]:
        """Return the map; empty if nothing has been seen yet."""
        if not self._last:
            return []
        return [map_message(self.grid.to_map(self.grid.config.occupied_above), now_ns)]


def _moved(before: SE2 | None, after: SE2, config: OccupancyGridConfig) -> bool:
    """Return whether the robot moved enough to see something new; None: nothing seen yet."""
    if before is None:
        return True
    distance_m = math.hypot(after.x_m - before.x_m, after.y_m - before.y_m)
    turned_rad = abs(wrap_angle(after.theta_rad - before.theta_rad))
    return distance_m >= config.update_min_m or turned_rad >= config.update_min_rad
