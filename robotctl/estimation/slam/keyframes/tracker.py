"""Registration: each scan is matched with a local map of the last keyframes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from robotctl.estimation.slam.front_end.surface import Floats, Surface
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.keyframes.growing_map import GrowingMap
from robotctl.estimation.slam.keyframes.hypotheses import (
    Hypothesis,
    HypothesisSearch,
    Sight,
    both_ways,
    is_elsewhere,
)
from robotctl.estimation.slam.keyframes.keyframe import (
    CORRIDOR,
    Keyframe,
    compared,
    is_corridor,
)
from robotctl.estimation.slam.keyframes.motion import OdometryAnchor, PredictedMotion
from robotctl.estimation.slam.keyframes.registration import Tracked, contradicts, track
from robotctl.estimation.slam.keyframes.robot_state import RobotState
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan

_REST_M: Final = 0.01
_REST_RAD: Final = 0.005
"""Odometry that moves less from scan to scan says that the robot stands."""
LEAST_ECHOES: Final = 10
"""Scans with fewer are not matched."""


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
    return Keyframe(scan, travelled_m) if is_new else None


class Tracker:
    """Registers each scan on the map of the last keyframes, and moves the robot there.

    Attributes
    ----------
    slips, unmatched
        Number of scans that contradict odometry; that match nothing near the prediction.
    ambiguous
        Number of scans without odometry that fit elsewhere nearly as well.
    unseen_m
        Distance without odometry along which scans saw nothing of it [m].
    """

    def __init__(self, growing: GrowingMap, robot: RobotState) -> None:
        self._config, self._keyframes, self._back_end = growing
        self._robot = robot
        self._hypotheses = HypothesisSearch(
            self._config.tuning.tracking, self._config.tuning.hypotheses
        )
        self._fruitless, self._pause = 0, self._config.tuning.trust.pause
        self.slips = self.unmatched = self.ambiguous = 0
        self.unseen_m = 0.0

    def step(self, scan: RangeScan, surface: Surface, predicted: PredictedMotion) -> Tracked:
        """Match a scan near its predicted place; the robot is where the match says."""
        robot = self._robot
        tracked = self._tracked(scan, surface, predicted)
        if tracked.has_slipped:
            self.slips += 1
            robot.anchor = OdometryAnchor()
        self._judge_odometry(tracked)
        if tracked.match is not None:
            robot.unmatched_in_a_row = 0
            seen = tracked.match.information / self._back_end.variance_factor
            both = np.linalg.inv(seen + predicted.information)
            robot.covariance = both.astype(np.float64)
        else:
            robot.covariance = robot.covariance + predicted.covariance
            if not self._config.stretch_m:
                self.unmatched += 1
                robot.unmatched_in_a_row += 1
        robot.advance(scan.stamp_ns, tracked.pose, is_seen=tracked.match is not None)
        return tracked

    def _tracked(self, scan: RangeScan, surface: Surface, predicted: PredictedMotion) -> Tracked:
        """Return the match of a scan; on a live map one that the last keyframes confirm."""
        config, robot, last = self._config, self._robot, self._robot.place
        unmatched = Tracked(last.pose @ predicted.motion, None, 0.0, has_slipped=False)
        if len(surface.points) < LEAST_ECHOES or config.stretch_m:
            return unmatched
        was_resumed, robot.is_resumed = robot.is_resumed, False
        if robot.has_odometry or was_resumed:
            tracked = track(robot.trail.local, surface, last.pose, predicted, config)
            if robot.has_odometry:
                tracked = self._doubted(tracked, scan, predicted)
        else:
            tracked = self._by_scans(scan, predicted)
        is_continuous = (
            robot.has_odometry and not tracked.has_slipped and robot.unmatched_in_a_row == 0
        )
        if not config.is_live or is_continuous:
            return tracked
        limits = config.tuning.tracking
        new, asked = (
            Keyframe(scan, robot.travelled_m),
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

    def _by_scans(self, scan: RangeScan, predicted: PredictedMotion) -> Tracked:
        """Return the most plausible place of a scan that nothing but scans predict."""
        config, robot = self._config, self._robot
        prior = robot.place.pose @ predicted.motion
        new = Keyframe(scan, robot.travelled_m)
        sight = Sight(robot.trail.local, new, new.surface.walls, self._seen(), prior, predicted)
        best, *others = self._hypotheses.step(sight)
        if not self._fits(best):
            return Tracked(prior, None, 0.0, has_slipped=False)
        limits = config.tuning.hypotheses
        self.ambiguous += bool(others) and best.worth - others[0].worth < limits.ambiguous
        least = best.evidence - limits.same_evidence
        if is_corridor(best.match, CORRIDOR) and any(each.evidence > least for each in others):
            step = robot.place.pose.inverse() @ best.match.pose
            self.unseen_m += float(np.hypot(step.x_m, step.y_m))
        return Tracked(best.match.pose, best.match, best.score, has_slipped=False)

    def _doubted(self, tracked: Tracked, scan: RangeScan, predicted: PredictedMotion) -> Tracked:
        """Return a match near the odometry, or a clearly better one where scans contradict that."""
        config, robot = self._config, self._robot
        motion = predicted.motion
        is_at_rest = bool(
            np.hypot(motion.x_m, motion.y_m) < _REST_M and abs(motion.theta_rad) < _REST_RAD
        )
        self._fruitless = 0 if is_at_rest else max(self._fruitless - 1, 0)
        follows = tracked.match is not None and not tracked.has_slipped
        if self._fruitless and follows:
            return tracked
        new, seen = Keyframe(scan, robot.travelled_m), self._seen()
        limits = config.tuning.trust
        if follows:
            through = [both_ways(old, new, pose.inverse() @ tracked.pose)[1] for old, pose in seen]
            if np.mean(through) < limits.through:
                self._pause = limits.pause
                return tracked
        habit = robot.habit.predict(1e-9 * (scan.stamp_ns - robot.place.stamp_ns))
        prior = robot.place.pose @ predicted.motion
        loose = replace(habit, motion=predicted.motion)
        sight = Sight(robot.trail.local, new, new.surface.walls, seen, prior, loose)
        near = self._hypotheses.expected(sight, predicted, tracked.match if follows else None)
        found = self._contradiction(sight, near, limits.lead_at_rest if is_at_rest else limits.lead)
        if found is not None:
            self._pause = limits.pause
            return Tracked(found.match.pose, found.match, found.score, has_slipped=True)
        self._fruitless, self._pause = self._pause, min(2 * self._pause, limits.longest_pause)
        is_slight = tracked.match is not None and not is_elsewhere(tracked.pose, near.match.pose)
        if follows or is_slight:
            return tracked
        if self._is_plausible(near):
            return Tracked(near.match.pose, near.match, near.score, has_slipped=False)
        return Tracked(prior, None, 0.0, has_slipped=False)

    def _contradiction(self, sight: Sight, near: Hypothesis, lead: float) -> Hypothesis | None:
        """Return a place that is more plausible, by a lead, than the one near the odometry."""
        best = self._hypotheses.step(sight)[0]
        if not self._fits(best) or not is_elsewhere(best.match.pose, near.match.pose):
            return None
        if best.worth <= near.worth + lead:
            return None
        # Walls that come into view, beside a robot in reverse, say nothing against odometry.
        if self._is_plausible(near) and best.evidence < near.evidence + lead:
            return None
        return best

    def _is_plausible(self, near: Hypothesis) -> bool:
        """Return whether what the last keyframes can tell of a scan is that it is there."""
        config = self._config
        sure = config.tuning.tracking.sure_score
        return near.evidence >= sure and near.match.inliers >= config.least_inliers

    def _fits(self, found: Hypothesis) -> bool:
        """Return whether a scan fits where it was found."""
        config = self._config
        return found.score >= config.least_score and found.match.inliers >= config.least_inliers

    def _judge_odometry(self, tracked: Tracked) -> None:
        """Compare the motion that a scan measured with that of the odometry."""
        robot = self._robot
        if robot.measured is None or tracked.match is None:
            return
        expected = robot.place.pose @ robot.measured.motion
        step = robot.place.pose.inverse() @ tracked.pose
        is_open = is_corridor(tracked.match, CORRIDOR)  # there all odometry agrees
        robot.trust.judge(
            contradicts=tracked.has_slipped or contradicts(expected, robot.measured, tracked.match),
            moved_m=0.0 if is_open else float(np.hypot(step.x_m, step.y_m)),
        )
        if not robot.trust.is_trusted:
            robot.anchor = OdometryAnchor()

    def _seen(self) -> list[tuple[Keyframe, SE2]]:
        """Return the last keyframes and their poses on the local map."""
        robot = self._robot
        return [
            (self._keyframes[each], self._back_end.between(robot.place.keyframe, each))
            for each in robot.trail.last(self._config.tuning.tracking.confirming_keyframes)
        ]


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
