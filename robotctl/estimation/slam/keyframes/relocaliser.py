"""Relocalisation: a lost robot is searched for on the whole map, one window in each step."""

from __future__ import annotations

from robotctl.estimation.slam.front_end.surface import Surface
from robotctl.estimation.slam.keyframes.growing_map import GrowingMap
from robotctl.estimation.slam.keyframes.keyframe import Keyframe
from robotctl.estimation.slam.keyframes.map_search import MapSearch
from robotctl.estimation.slam.keyframes.motion import PredictedMotion, ScanPose
from robotctl.estimation.slam.keyframes.robot_state import RobotState
from robotctl.estimation.slam.keyframes.tracker import LEAST_ECHOES
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan


class Relocaliser:
    """Searches for one scan after another until the place of one is found.

    Attributes
    ----------
    found
        Number of times the robot was found.
    """

    def __init__(self, growing: GrowingMap, robot: RobotState) -> None:
        self._robot = robot
        self._growing = growing
        self._search: MapSearch | None = None
        self._since_scan = SE2()
        """Motion since the scan that is searched for."""
        self.found = 0

    @property
    def is_searching(self) -> bool:
        """Whether a search is under way."""
        return self._search is not None

    def reset(self) -> None:
        """Abandon the search."""
        self._search = None

    def add(self, scan: RangeScan, surface: Surface, predicted: PredictedMotion) -> None:
        """Move a lost robot by its predicted motion; search for the scan if idle."""
        robot, last = self._robot, self._robot.place
        self._since_scan = self._since_scan @ predicted.motion
        if self._search is None and len(surface.points) >= LEAST_ECHOES:
            new = Keyframe(scan, robot.travelled_m)
            self._search = MapSearch(self._growing, new)
            self._since_scan = SE2()
        robot.place = ScanPose(scan.stamp_ns, last.keyframe, last.pose @ predicted.motion)

    def step(self) -> bool:
        """Search one more window; return whether the robot was found, and is there now."""
        search, last = self._search, self._robot.place
        if search is None or not search.step():
            return False
        self._search = None
        if search.found is None:
            return False
        number, pose = search.found
        place = ScanPose(last.stamp_ns, number, pose @ self._since_scan)
        self._robot.relocate(place, self._robot.odometry)
        self.found += 1
        return True
