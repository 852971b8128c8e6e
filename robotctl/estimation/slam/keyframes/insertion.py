"""Insertion of new keyframes: a node of the graph, its links, and the optimum that they move."""

from __future__ import annotations

from typing import Final

import numpy as np

from robotctl.estimation.slam.front_end.point_to_line import Match
from robotctl.estimation.slam.keyframes.back_end import KeyframeLink
from robotctl.estimation.slam.keyframes.growing_map import GrowingMap
from robotctl.estimation.slam.keyframes.keyframe import Keyframe
from robotctl.estimation.slam.keyframes.linking import Linking
from robotctl.estimation.slam.keyframes.motion import ScanPose
from robotctl.estimation.slam.keyframes.robot_state import RobotState
from robotctl.model.geometry.se2 import SE2

_UNKNOWN: Final = np.diag(1.0 / np.array([0.3, 0.3, 0.2]) ** 2)
"""Information of a link without odometry, which only keeps the graph solvable."""


class KeyframeInsertion:
    """Adds keyframes to the map, at the robot.

    Parameters
    ----------
    growing
        The map.
    robot
        State of the robot on it.
    linking
        Links by scans.
    """

    def __init__(self, growing: GrowingMap, robot: RobotState, linking: Linking) -> None:
        self._config, self._keyframes, self._back_end = growing
        self._robot = robot
        self._linking = linking

    def step(self, new: Keyframe, pose: SE2, match: Match | None) -> None:
        """Add a keyframe at a pose in the last one, link it and optimise the graph.

        Parameters
        ----------
        new, pose
            The keyframe; the robot stands in it afterwards.
        match
            Match with the map of the last keyframes; None if there is none.
        """
        robot, back_end, number = self._robot, self._back_end, len(self._keyframes)
        last = robot.place.keyframe
        by_wheels = robot.anchor.moved_to(robot.odometry, self._config.wheels)
        passed = robot.trail.last(self._config.linked_keyframes)
        self._keyframes.append(new)
        robot.pass_keyframe(ScanPose(new.stamp_ns, number, SE2()))
        if number == 0:
            back_end.add(pose)
            return
        back_end.add(back_end.pose(last) @ pose)
        # Odometry holds what scans do not see, such as the distance along a corridor.
        if by_wheels is not None:
            back_end.link(KeyframeLink(last, number, by_wheels.motion, by_wheels.information))
        else:
            back_end.link(KeyframeLink(last, number, pose, _UNKNOWN))
        if self._linking.link_last(number, passed) == 0 and match is not None:
            back_end.link(KeyframeLink(last, number, pose, match.information))
        self._linking.link_near(number, passed, robot.unmeasured_m)
        back_end.update()
        if self._config.stretch_m:
            robot.fuse_loop(back_end)
