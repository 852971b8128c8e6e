"""SLAM by lidar in the navigation process: the robot's place on a map that grows as it drives."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.app.localisation.localiser import LocaliserInput, localisation_state
from robotctl.config.robot_file import RobotConfig
from robotctl.estimation.grid.occupancy_grid import OccupancyGrid
from robotctl.estimation.odometry.odometry_history import OdometryHistory
from robotctl.estimation.sensors.registry import LIDAR, load_sensors
from robotctl.estimation.sensors.sensor import SensedRobot
from robotctl.estimation.slam.lidar.config import LidarSlamConfig
from robotctl.estimation.slam.lidar.mapper import LEAST_ECHOES, SlamMapper
from robotctl.messages.control import ControlState
from robotctl.messages.estimation import LiveMap, LocalisationState
from robotctl.messages.map_message import map_message
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.points import moved, rotation
from robotctl.model.geometry.pose_estimate import PoseEstimate
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan

_LEAST_M: Final = 0.05
_LEAST_RAD: Final = 0.05
"""A robot at rest sees the same again."""
_LOST: Final = 10
"""So many scans in a row that fit nowhere: the robot does not know its place."""
_AT_ONCE: Final = 40
"""Keyframes that are drawn in one step, when the map is drawn anew."""
_SHIFT_M: Final = 0.03
"""A keyframe that moved farther since it was drawn has the map drawn anew."""


class SlamLocaliser:
    """Feeds a `SlamMapper` with the lidar's scans; its `map` lies in `world` where it starts.

    Parameters
    ----------
    mapper
        Without a scan yet.
    start
        `base` in `world` at the start.
    history
        Of the odometry; kept up to date by the caller.
    """

    def __init__(self, mapper: SlamMapper, start: SE2, history: OdometryHistory) -> None:
        self.mapper = mapper
        self._history = history
        self.T_world_map = start
        self._begun = self._pose = start
        """Pose in `world` where the odometry began, and now."""
        self._T_world_odom: SE2 | None = None
        self._last: SE2 | None = None
        """Odometry at the last scan that was taken."""
        self._notices: list[str] = []
        self._closed = 0

    @property
    def particles(self) -> NDArray[np.float64]:
        """No particles: (0, 3)."""
        return np.empty((0, 3))

    def begin_odometry(self) -> None:
        """Keep the map; the next control state's odometry is another one."""
        self.mapper.begin_odometry()
        self._begun = self._pose
        self._T_world_odom = self._last = None

    def take_notices(self) -> list[str]:
        """Return which loops were closed since the last call."""
        notices, self._notices = self._notices, []
        return notices

    def step(self, control: ControlState, seen: LocaliserInput, now_ns: int) -> LocalisationState:
        """Take the scans since the last step; return the present estimate."""
        for scan in seen.measured.get(LIDAR, ()):
            odometry = self._history.at(scan.stamp_ns)
            if odometry is not None and self._is_new(odometry):
                self._take(scan, odometry)
        if self._T_world_odom is None:
            self._T_world_odom = self._begun @ control.T_odom_base.inverse()
        is_placed = bool(self.mapper.keyframes) and self.mapper.lost_in_a_row < _LOST
        status = LocalisationStatus.LOCALISED if is_placed else LocalisationStatus.SEARCHING
        odometry = control.T_odom_base
        self._pose = self._T_world_odom @ odometry
        covariance = self._covariance(self._pose)
        estimate = PoseEstimate(control.stamp_ns, self._pose, covariance, status)
        return localisation_state("slam", estimate, odometry, now_ns)

    def _is_new(self, odometry: SE2) -> bool:
        """Return whether the robot has moved since the last scan."""
        if self._last is None:
            return True
        motion = self._last.inverse() @ odometry
        return (
            math.hypot(motion.x_m, motion.y_m) >= _LEAST_M
            or abs(wrap_angle(motion.theta_rad)) >= _LEAST_RAD
        )

    def _take(self, scan: RangeScan, odometry: SE2) -> None:
        """Match a scan."""
        echoes = np.isfinite(scan.ranges_m) & (scan.ranges_m < scan.max_range_m)
        if not self.mapper.keyframes and np.count_nonzero(echoes) < 2 * LEAST_ECHOES:
            return
        if not self.mapper.keyframes:
            # What was driven before the first scan is known by odometry alone.
            before = self._T_world_odom
            self.T_world_map = self._begun if before is None else before @ odometry
        self.mapper.add(scan, odometry)
        self._last = odometry
        self._T_world_odom = self.T_world_map @ self.mapper.pose @ odometry.inverse()
        if self.mapper.epoch > self._closed:
            self._closed = self.mapper.epoch
            self._notices.append(f"loop closed: {self._closed} so far, the map is corrected")

    def _covariance(self, pose: SE2) -> NDArray[np.float64]:
        """Return the covariance (3, 3) of the last match, in `world`."""
        turn = np.eye(3)
        turn[:2, :2] = rotation(pose.theta_rad)
        result: NDArray[np.float64] = turn.T @ self.mapper.covariance @ turn
        return result


class SlamDrawing:
    """The occupancy grid of a `SlamLocaliser`: its keyframes, drawn where they are now.

    After a closure all are drawn anew, some in each step, and shown when that is done.
    """

    def __init__(self, localiser: SlamLocaliser, grid: OccupancyGrid) -> None:
        self._localiser = localiser
        self.grid = grid
        self._drawn = np.empty((0, 3))
        """Poses at which keyframes are in the grid."""
        self._next: OccupancyGrid | None = None
        self._next_drawn = np.empty((0, 3))

    def step(self, _localisation: LocalisationState | None, _seen: LocaliserInput) -> None:
        """Draw keyframes that are new, or some of those that have moved."""
        poses = self._localiser.mapper.back_end.poses
        known = len(self._drawn)
        off = np.hypot(*(poses[:known, :2] - self._drawn[:, :2]).T)
        if self._next is None and off.max(initial=0.0) > _SHIFT_M:
            self._next, self._next_drawn = OccupancyGrid(self.grid.config), np.empty((0, 3))
        self._drawn = self._draw(self.grid, self._drawn)
        if self._next is None:
            return
        self._next_drawn = self._draw(self._next, self._next_drawn)
        if len(self._next_drawn) == len(poses):
            self.grid, self._drawn, self._next = self._next, self._next_drawn, None

    def _draw(self, grid: OccupancyGrid, drawn: NDArray[np.float64]) -> NDArray[np.float64]:
        """Draw keyframes from the first that is not in a grid; return the poses of all in it."""
        mapper, T_world_map = self._localiser.mapper, self._localiser.T_world_map
        begin = len(drawn)
        new = mapper.back_end.poses[begin : begin + _AT_ONCE]
        if len(new) == 0:
            return drawn
        placed = np.column_stack(
            [moved(T_world_map, new[:, :2]), new[:, 2] + T_world_map.theta_rad]
        )
        grid.update_scans(
            placed, [each.scan for each in mapper.keyframes[begin : begin + len(new)]]
        )
        return np.concatenate([drawn, new])

    def live_map(self, now_ns: int) -> LiveMap | None:
        """Return the map; None if nothing has been seen yet."""
        if len(self._drawn) == 0:
            return None
        return map_message(self.grid.to_map(), now_ns)


def make_slam(
    config: RobotConfig, robot: SensedRobot, start: SE2, history: OdometryHistory
) -> tuple[SlamLocaliser, SlamDrawing]:
    """Return the mapper of a robot that knows no map, compiled, and what draws it."""
    lidar = load_sensors()[LIDAR].rehearsal(robot)
    rehearsed = SlamLocaliser(SlamMapper(LidarSlamConfig(keyframe_m=0.0)), SE2(), OdometryHistory())
    if lidar is not None:
        for _ in range(rehearsed.mapper.config.linked_keyframes + 2):
            rehearsed.mapper.add(lidar, SE2())
        drawing = SlamDrawing(rehearsed, OccupancyGrid(config.localisation.grid))
        drawing.step(None, LocaliserInput())
        drawing.live_map(0)
    localiser = SlamLocaliser(SlamMapper(), start, history)
    return localiser, SlamDrawing(localiser, OccupancyGrid(config.localisation.grid))
