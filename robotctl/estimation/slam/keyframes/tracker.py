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
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.keyframes.keyframe import Keyframe, compared, held, keyframe_of
from robotctl.estimation.slam.keyframes.local_map import LocalMap, thinned
from robotctl.estimation.slam.keyframes.motion import CONTRADICTS, OdometryAnchor, PredictedMotion
from robotctl.estimation.slam.keyframes.robot_state import RobotState
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan

LEAST_ECHOES: Final = 10
"""Scans with fewer are not matched."""
SEARCH_POINTS: Final = 180
_WIDE_M: Final = 1.0
_WIDE_POINTS: Final = 60
"""In a window of a metre and more to each side; there the time goes, and any place is a start for
the refinement by all points."""
_SURE: Final = 0.6
"""A match with a lower score is compared with those of a wider search."""
_BETTER: Final = 0.2
"""Lead in score that a match farther from the prior needs to replace a nearer one."""
_WIDER: Final = 2.5
_LOST_M: Final = 0.5
_LOST_RAD: Final = 0.5
"""Doubt of the prior in the wider search at least: wheels slip, clocks jump."""
_FARTHEST_M: Final = 2.5
_CORRIDOR: Final = 0.01
"""Information along, beside that across, where walls say nothing of the place along them."""
_STILL_MATCHES: Final = 0.75
_ASKED: Final = 4
_CONFIRMED: Final = 0.6
"""Minimum score of a match that does not follow from where the robot was."""
_MOVED: Final = 0.05
"""Share of two scans that may contradict, of half of the keyframes asked about a place."""


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
    prior = last @ predicted.motion
    score, match = _attempt(local, surface, prior, predicted)
    if score < _SURE or match.inliers < config.least_inliers:
        lost = PredictedMotion(
            predicted.motion,
            max(_WIDER * predicted.sigma_m, _LOST_M),
            max(_WIDER * predicted.sigma_rad, _LOST_RAD),
        )
        wide_score, wide = _attempt(local, surface, prior, lost)
        fits = score >= config.least_score and match.inliers >= config.least_inliers
        if not fits or wide_score > score + _BETTER:
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
        new, asked = keyframe_of(scan, surface, robot.travelled_m), robot.trail.last(_ASKED)
        at = self._back_end.pose(last.keyframe) @ tracked.pose
        if tracked.score < _SURE or not is_borne_out(
            new, at, [self._keyframes[each] for each in asked], self._back_end.poses[asked]
        ):
            return unmatched
        robot.keep_keyframes()
        return replace(tracked, has_slipped=tracked.has_slipped and not was_resumed)


def is_borne_out(new: Keyframe, at: SE2, asked: Sequence[Keyframe], poses: Floats) -> bool:
    """Return whether half of some keyframes at poses (n, 3) confirm a scan taken at a pose.

    A robot that was carried away may be where much looks the same.
    """
    agreeing = 0
    for old, row in zip(asked, poses.tolist(), strict=True):
        agreeing += compared(old, new, SE2(*row).inverse() @ at)[1] < _MOVED
    return 2 * agreeing >= len(asked)


def _attempt(
    local: LocalMap, surface: Surface, prior: SE2, predicted: PredictedMotion
) -> tuple[float, Match]:
    """Return score and refined match of the best pose around a prior."""
    window = Window(
        prior,
        min(3.0 * predicted.sigma_m, _FARTHEST_M),
        min(3.0 * predicted.sigma_rad, np.pi),
        predicted.sigma_m,
        predicted.sigma_rad,
    )
    most = SEARCH_POINTS if window.shift_m < _WIDE_M else _WIDE_POINTS
    found = search(local.field, thinned(surface.points, most), window, -1.0)
    start, score = (prior, 0.0) if found is None else (found.pose, found.score)
    match = refine(local.bins, surface, start, prior, predicted.information)
    return score, _held(local, surface, match, prior, predicted)


def _held(
    local: LocalMap, surface: Surface, match: Match, prior: SE2, predicted: PredictedMotion
) -> Match:
    """Return a match which the prior holds along a corridor, if it is in one.

    There the search prefers to stand still, where all of a scan overlaps with the map. Zhang,
    Kaess, Singh: On degeneracy of optimization-based state estimation problems, ICRA 2016.
    """
    start = held(match, prior, _CORRIDOR)
    if start is match.pose:
        return match
    along = refine(local.bins, surface, start, prior, predicted.information, NARROW_M)
    return along if along.inliers > _STILL_MATCHES * match.inliers else match


def _contradicts(prior: SE2, predicted: PredictedMotion, match: Match) -> bool:
    """Return whether the match is too far from what was predicted."""
    r = np.array((prior.inverse() @ match.pose).log())
    S = predicted.covariance + np.linalg.inv(match.information + 1e-3 * np.eye(3))
    return float(r @ np.linalg.solve(S, r)) > CONTRADICTS
