"""Straight walls, which hold the heading of scans that overlap with no others.

A stretch of a corridor and the next show different pieces of its walls. Where a piece of the one
lies in line with one of the other, as far as odometry can tell, both are taken as one wall.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from robotctl.estimation.landmarks.line_fitting import BeamNoise
from robotctl.estimation.landmarks.scan_lines import ScanLinesConfig, Segment, find_lines
from robotctl.estimation.slam.front_end.surface import Floats
from robotctl.estimation.slam.keyframes.back_end import KeyframeLink
from robotctl.estimation.slam.keyframes.growing_map import GrowingMap
from robotctl.estimation.slam.keyframes.keyframe import LOOSE, Keyframe, without_corridor
from robotctl.estimation.slam_tuning import StraightWallsConfig
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.points import moved, rotation
from robotctl.model.geometry.se2 import SE2

_LINES: Final = ScanLinesConfig(BeamNoise(sigma_m=0.02), least_length_m=1.2)


class StraightWalls:
    """Finds the walls that keyframes have in line with earlier ones."""

    def __init__(self, growing: GrowingMap) -> None:
        config, self._keyframes, self._back_end = growing
        self._stretch_m, self._shared = config.stretch_m, config.shared
        self._config = config.tuning.walls
        self._walls: dict[int, tuple[Keyframe, tuple[Segment, ...]]] = {}
        self._first = 0
        """The first keyframe of this odometry."""

    def begin_odometry(self) -> None:
        """Treat the next keyframe as the first of another odometry, which may begin elsewhere."""
        self._first = len(self._keyframes)

    def link(self, number: int) -> int:
        """Link a keyframe with earlier ones by walls that are in line; return how many."""
        count = 0
        for other in self._near(number):
            start = self._back_end.between(other, number)
            found = aligned(self._walls_of(other), self._walls_of(number), start, self._config)
            if found is not None:
                pose, information = found
                self._back_end.link(KeyframeLink(other, number, pose, information / self._shared))
                count += 1
                if count == self._config.compared:
                    break
        return count

    def _walls_of(self, number: int) -> tuple[Segment, ...]:
        """Return the walls of a keyframe, which may have another scan by now."""
        keyframe = self._keyframes[number]
        if number not in self._walls or self._walls[number][0] is not keyframe:
            self._walls[number] = keyframe, find_lines(keyframe.scan, _LINES).segments
        return self._walls[number][1]

    def _near(self, number: int) -> list[int]:
        """Return earlier keyframes near one, the last first, a stretch between each two."""
        ways_m = np.array([each.travelled_m for each in self._keyframes[: number + 1]])
        poses = self._back_end.poses
        away = np.hypot(*(poses[:number, :2] - poses[number, :2]).T)
        near: list[int] = []
        next_m = ways_m[number] - self._stretch_m
        is_near = (away < self._config.apart_m) & (
            ways_m[:number] > ways_m[number] - self._config.back_m
        )
        is_near[: self._first] = False
        for other in np.flatnonzero(is_near)[::-1].tolist():
            if ways_m[other] <= next_m:
                near.append(other)
                next_m = ways_m[other] - self._stretch_m
        return near


def aligned(
    first: tuple[Segment, ...],
    second: tuple[Segment, ...],
    start: SE2,
    config: StraightWallsConfig,
) -> tuple[SE2, Floats] | None:
    """Return the pose of the second scan in the first at which walls are in line.

    Parameters
    ----------
    first, second
        Walls of two scans.
    start
        The expected pose, which remains where no wall says anything.
    config
        When walls are in line.

    Returns
    -------
    The pose, and its information (3, 3) in its own frame; None if no wall is in line.
    """
    H, g = np.zeros((3, 3)), np.zeros(3)
    for old in first:
        for new in second:
            row = _in_line(old, new, start, config)
            if row is not None:
                residuals, J, information = row
                H += J.T @ (information[:, None] * J)
                g += J.T @ (information * residuals)
    if not H.any():
        return None
    step = np.linalg.solve(H + LOOSE, -g)
    return start @ SE2.exp(*step.tolist()), without_corridor(H)


def _in_line(
    old: Segment, new: Segment, pose: SE2, config: StraightWallsConfig
) -> tuple[Floats, Floats, Floats] | None:
    """Return residuals of direction and offset, (2,), their Jacobian and information; or None.

    The offset is measured across the mean direction, between the middles of the pieces.
    """
    turn = wrap_angle(new.line.alpha_rad + pose.theta_rad - old.line.alpha_rad)
    if abs(turn) > config.gate_rad:
        return None
    middle = new.ends.mean(axis=0)
    between = moved(pose, middle[None])[0] - old.ends.mean(axis=0)
    alpha = old.line.alpha_rad + 0.5 * turn
    normal = np.array([math.cos(alpha), math.sin(alpha)])
    off, apart = float(normal @ between), float(np.hypot(*between))
    if abs(off) > config.gate_m or apart > config.apart_m:
        return None
    own = rotation(pose.theta_rad) @ normal
    along = float(np.array([-normal[1], normal[0]]) @ between)
    by_turn = own @ np.array([-middle[1], middle[0]]) + 0.5 * along
    J = np.array([[0.0, 0.0, 1.0], [own[0], own[1], by_turn]])
    turned = sum(
        each.line.covariance[0, 0] + (config.thickness_m / each.length_m) ** 2
        for each in (old, new)
    )
    moved_m2 = config.bend_m**2 + 0.25 * apart**2 * turned
    is_one = abs(off) < config.offset_m
    return np.array([turn, off]), J, np.array([1.0 / turned, is_one / moved_m2])
