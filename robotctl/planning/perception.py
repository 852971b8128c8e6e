"""Sensor data around the robot, handed to the obstacle guard and the pilot."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from robotctl.model.footprint import Footprint
from robotctl.model.geometry.points import moved, rotation
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.planning.behave.behaviours.behaviour import BehaviourInput
from robotctl.planning.behave.behaviours.kind import NavigatedRobot
from robotctl.planning.guard.echo_memory import EchoMemory
from robotctl.planning.guard.echo_motion import STANDS, EchoMotion
from robotctl.planning.guard.scan_memory import ScanMemory
from robotctl.planning.map.seen import Seen
from robotctl.planning.navigation_step import NavigationInputs

_SCAN_LIFE_NS = 500_000_000
"""An older scan says nothing of what is around now [ns]."""


class Perception:
    """Lets guard and pilot see what the sensors see.

    Parameters
    ----------
    robot
        With its guard, and its pilot once it has one.
    lidars
        Number of its lidars; if one of them is silent, the robot sees as little as without any.
    """

    def __init__(self, robot: NavigatedRobot, lidars: int = 0) -> None:
        self._robot, self._lidars = robot, lidars
        self._echo_motion = EchoMotion(robot.mounts, robot.config.guard.approach)
        body, memory = robot.guard.body, robot.config.guard.memory
        self._passed = EchoMemory(robot.mounts, body, memory)
        self._received_ns = (-1,) * len(robot.mounts)
        self._hidden = ScanMemory(body, memory)
        self._scans: dict[str, tuple[SE2, RangeScan, int]] = {}
        """The last of each lidar, with `base` in `odom` at its time, and when it came [ns]."""
        self._epoch: tuple[int, int] | None = None
        """Epoch of everything seen so far."""

    def use_body(self, body: Footprint) -> None:
        """Remember what is near another body from now on."""
        self._passed.use_body(body)
        self._hidden.use_body(body)

    def observe(self, inputs: NavigationInputs, now_ns: int) -> BehaviourInput:
        """Take in what is new; return it for behaviours."""
        ranges, received_ns = inputs.ranges_m, inputs.received_ns
        count, pilot = len(self._robot.mounts), self._robot.pilot
        if len(ranges) != count or len(received_ns) != count:
            ranges, received_ns = (math.nan,) * count, (0,) * count
        new = tuple(now > then for now, then in zip(received_ns, self._received_ns, strict=True))
        self._received_ns = received_ns
        if inputs.epoch != self._epoch:  # all was seen from a wrong place
            self._epoch, self._scans = inputs.epoch, {}
            self._passed.reset()
            self._hidden.reset()
            if pilot is not None:
                pilot.forget()
        for T_odom_base, scan in inputs.scans:
            self._scans[scan.name] = T_odom_base, scan, now_ns
            if self._robot.drive.holonomic:
                self._hidden.see(T_odom_base, scan, now_ns)
        points = self._scanned(inputs, now_ns)
        approaches = self._echo_motion.step(ranges, new, received_ns, inputs.twist)
        heard = tuple(
            reading if is_new else math.nan for reading, is_new in zip(ranges, new, strict=True)
        )
        moves = tuple(approach is not STANDS for approach in approaches)
        passed = None
        if points is None:  # a lidar sees what is beside the robot
            passed = self._passed.hear(self._odometry(inputs), heard, moves, now_ns)
        if pilot is not None and inputs.localised:
            seen = Seen(inputs.T_world_odom, inputs.scans, heard, inputs.floor_base, approaches)
            pilot.see(inputs.pose, seen, now_ns)
            approaches = self._echo_motion.expect(approaches, ranges, pilot.may_move, now_ns)
        self._robot.guard.observe(
            ranges,
            new,
            inputs.floor_base,
            points,
            approaches,
            passed,
            inputs.twist,
            self._moving(inputs.pose),
        )
        markers = [(number, inputs.T_world_odom @ pose) for number, pose in inputs.markers]
        return BehaviourInput(
            inputs.pose, inputs.twist, ranges, new, inputs.epoch, inputs.charge, markers
        )

    def _moving(self, pose: SE2) -> list[list[float]]:
        """Return what a lidar sees move, in `base`: x, y, vx, vy, radius [m, m/s]."""
        if self._robot.pilot is None or not len(moving := self._robot.pilot.moving):
            return []
        places = moved(pose.inverse(), moving[:, :2])
        speeds = moving[:, 2:4] @ rotation(-pose.theta_rad)
        rows: list[list[float]] = np.column_stack([places, speeds, moving[:, 4]]).tolist()
        return rows

    @staticmethod
    def _odometry(inputs: NavigationInputs) -> SE2:
        """Return `base` in `odom` now."""
        return inputs.T_world_odom.inverse() @ inputs.pose

    def _scanned(self, inputs: NavigationInputs, now_ns: int) -> NDArray[np.float64] | None:
        """Return the points of the lidars' last scans in `base` now, (n, 2) [m].

        None if one of the lidars is silent.
        With those that a holonomic robot, which may go there, has passed and does not see any more.
        """
        scans = self._scans.values()
        if len(scans) < max(self._lidars, 1) or any(
            now_ns - came_ns > _SCAN_LIFE_NS for *_, came_ns in scans
        ):
            return None
        T_base_odom = self._odometry(inputs).inverse()
        points = np.concatenate(
            [moved(T_base_odom @ then, scan.points_base()) for then, scan, _ in scans]
        )
        if not self._robot.drive.holonomic:
            return points
        return np.concatenate([points, self._hidden.around(T_base_odom, now_ns)])
