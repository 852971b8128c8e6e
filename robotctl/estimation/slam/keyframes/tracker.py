"""Registration: each scan is matched with a local map of the last keyframes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from robotctl.estimation.slam.front_end.correlative import Window, search
from robotctl.estimation.slam.front_end.point_to_line import NARROW_M, Match, refine
from robotctl.estimation.slam.front_end.surface import Floats, Surface
from robotctl.estimation.slam.keyframes.back_end import BackEnd
from robotctl.estimation.slam.keyframes.keyframe import Keyframe, compared, held, keyframe_of
from robotctl.estimation.slam.keyframes.local_map import LocalMap, thinned
from robotctl.estimation.slam.keyframes.motion import CONTRADICTS, OdometryAnchor, PredictedMotion
from robotctl.estimation.slam.keyframes.robot_state import RobotState
from robotctl.estimation.slam_config import KeyframeConfig, TrackingConfig
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan

LEAST_ECHOES: Final = 10
"""Scans with fewer are not matched."""


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """A scan's place on the local map.

    Parameters
    ----------
    pose
        Of `base` in the frame of the local map.
    match
        None if the scan does not fit anywhere near: the pose is the predicted one then.
    score
        Of the search.
    has_slipped
        Whether odometry contradicts the match.
    """

    pose: SE2
    match: Match | None
    score: float
    has_slipped: bool


def track(
    local: LocalMap, surface: Surface, last: SE2, predicted: PredictedMotion, config: KeyframeConfig
) -> Tracked:
    """Return where a scan was taken, after a motion from a last pose on a local map."""
    prior, limits = last @ predicted.motion, config.tuning.tracking
    score, match = _attempt(local, surface, prior, predicted, limits)
    if score < limits.sure_score or match.inliers < config.least_inliers:
        lost = PredictedMotion(
            predicted.motion,
            max(limits.wider * predicted.sigma_m, limits.wider_m),
            max(limits.wider * predicted.sigma_rad, limits.wider_rad),
        )
        wide_score, wide = _attempt(local, surface, prior, lost, limits)
        fits = score >= config.least_score and match.inliers >= config.least_inliers
        if not fits or wide_score > score + limits.better_score:
            score, match = wide_score, wide
    if score < config.least_score or match.inliers < config.least_inliers:
        return Tracked(prior, None, 0.0, has_slipped=False)
    return Tracked(match.pose, match, score, _contradicts(prior, predicted, match))


def new_keyframe(
    scan: RangeScan,
    surface: Surface,
    tracked: Tracked,
    travelled_m: float,
    config: KeyframeConfig,
) -> Keyframe | None:
    """Return the keyframe of a scan, placed in the frame of the last one; None: it adds too little.

    A live map takes no scan that matches nothing.
    """
    pose, match = tracked.pose, tracked.match
    if len(surface.points) < LEAST_ECHOES:
        return None
    if config.is_live and match is None and not config.stretch_m:
        return None
    is_new = (
        float(np.hypot(pose.x_m, pose.y_m)) >= config.keyframe_m
        or abs(pose.theta_rad) >= config.keyframe_rad
        or (match is not None and match.inliers < config.keyframe_overlap)
    )
    return keyframe_of(scan, surface, travelled_m) if is_new else None


class Tracker:
    """Registers each scan on the map of the last keyframes, and moves the robot there.

    Attributes
    ----------
    slips, unmatched
        Number of scans that contradict odometry; that match nothing near the prediction.
    """

    def __init__(
        self,
        config: KeyframeConfig,
        keyframes: list[Keyframe],
        back_end: BackEnd,
        robot: RobotState,
    ) -> None:
        self._config = config
        self._keyframes = keyframes
        self._back_end = back_end
        self._robot = robot
        self.slips = self.unmatched = 0

    def step(self, scan: RangeScan, surface: Surface, predicted: PredictedMotion) -> Tracked:
        """Match a scan near its predicted place; the robot is where the match says."""
        robot = self._robot
        tracked = self._tracked(scan, surface, predicted)
        if tracked.has_slipped:
            self.slips += 1
            robot.anchor = OdometryAnchor()
        if tracked.match is not None:
            robot.unmatched_in_a_row = 0
            both = np.linalg.inv(tracked.match.information + predicted.information)
            robot.covariance = both.astype(np.float64)
        else:
            robot.covariance = robot.covariance + predicted.covariance
            if not self._config.stretch_m:
                self.unmatched += 1
                robot.unmatched_in_a_row += 1
        robot.advance(scan.stamp_ns, tracked.pose)
        return tracked

    def _tracked(self, scan: RangeScan, surface: Surface, predicted: PredictedMotion) -> Tracked:
        """Return the match of a scan; on a live map one that the last keyframes confirm."""
        config, robot, last = self._config, self._robot, self._robot.place
        unmatched = Tracked(last.pose @ predicted.motion, None, 0.0, has_slipped=False)
        if len(surface.points) < LEAST_ECHOES or config.stretch_m:
            return unmatched
        was_resumed, robot.is_resumed = robot.is_resumed, False
        tracked = track(robot.trail.local, surface, last.pose, predicted, config)
        is_continuous = (
            robot.has_odometry and not tracked.has_slipped and robot.unmatched_in_a_row == 0
        )
        if not config.is_live or is_continuous:
            return tracked
        limits = config.tuning.tracking
        new, asked = (
            keyframe_of(scan, surface, robot.travelled_m),
            robot.trail.last(limits.confirming_keyframes),
        )
        at = self._back_end.pose(last.keyframe) @ tracked.pose
        if tracked.score < limits.confirmed_score or not is_confirmed(
            new,
            at,
            [self._keyframes[each] for each in asked],
            self._back_end.poses[asked],
            limits.confirmed_contradiction,
        ):
            return unmatched
        robot.keep_keyframes()
        return replace(tracked, has_slipped=tracked.has_slipped and not was_resumed)


def is_confirmed(
    new: Keyframe, at: SE2, asked: Sequence[Keyframe], poses: Floats, most_contradicting: float
) -> bool:
    """Return whether half of some keyframes at poses (n, 3) confirm a scan taken at a pose.

    A robot that was carried away may be where much looks the same.
    """
    agreeing = 0
    for old, row in zip(asked, poses.tolist(), strict=True):
        agreeing += compared(old, new, SE2(*row).inverse() @ at)[1] < most_contradicting
    return 2 * agreeing >= len(asked)


def _attempt(
    local: LocalMap,
    surface: Surface,
    prior: SE2,
    predicted: PredictedMotion,
    limits: TrackingConfig,
) -> tuple[float, Match]:
    """Return score and refined match of the best pose around a prior."""
    window = Window(
        prior,
        min(3.0 * predicted.sigma_m, limits.farthest_m),
        min(3.0 * predicted.sigma_rad, np.pi),
        predicted.sigma_m,
        predicted.sigma_rad,
    )
    most = limits.search_points if window.shift_m < limits.wide_m else limits.wide_points
    found = search(local.field, thinned(surface.points, most), window, -1.0)
    start, score = (prior, 0.0) if found is None else (found.pose, found.score)
    match = refine(local.bins, surface, start, prior, predicted.information)
    return score, _held(local, surface, match, prior, predicted, limits)


def _held(
    local: LocalMap,
    surface: Surface,
    match: Match,
    prior: SE2,
    predicted: PredictedMotion,
    limits: TrackingConfig,
) -> Match:
    """Return a match which the prior holds along a corridor, if it is in one.

    There the search prefers to stand still, where all of a scan overlaps with the map. Zhang,
    Kaess, Singh: On degeneracy of optimization-based state estimation problems, ICRA 2016.
    """
    start = held(match, prior, limits.corridor)
    if start is match.pose:
        return match
    along = refine(local.bins, surface, start, prior, predicted.information, NARROW_M)
    return along if along.inliers > limits.still_matches * match.inliers else match


def _contradicts(prior: SE2, predicted: PredictedMotion, match: Match) -> bool:
    """Return whether the match is too far from what was predicted."""
    r = np.array((prior.inverse() @ match.pose).log())
    S = predicted.covariance + np.linalg.inv(match.information + 1e-3 * np.eye(3))
    return float(r @ np.linalg.solve(S, r)) > CONTRADICTS
