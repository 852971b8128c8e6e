"""Places that are on the map already: no more keyframes, but a new scan where they changed.

A robot that stays in one building keeps a map of constant size, which shows what was seen last.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from robotctl.estimation.slam.front_end.surface import Floats
from robotctl.estimation.slam.keyframes.back_end import BackEnd, certain
from robotctl.estimation.slam.keyframes.growing_map import GrowingMap
from robotctl.estimation.slam.keyframes.keyframe import Keyframe, compared, match_pair
from robotctl.estimation.slam.keyframes.motion import CONTRADICTS, PredictedMotion, ScanPose
from robotctl.estimation.slam.keyframes.robot_state import RobotState
from robotctl.estimation.slam_tuning import KnownPlacesConfig
from robotctl.model.geometry.se2 import SE2


@dataclass(frozen=True, slots=True)
class Known:
    """The keyframe of a known place.

    Parameters
    ----------
    number
        Number of the keyframe.
    pose
        Pose of `base` in it.
    contradicts
        Fraction of contradicting points of the two scans.
    is_young
        Whether its scan was taken within the last metres.
    information
        Information (3, 3) of the pose in its own frame; None without a match.
    """

    number: int
    pose: SE2
    contradicts: float
    is_young: bool
    information: Floats | None = None

    def weighed(self, start: SE2, covariance: Floats) -> tuple[Known, Floats] | None:
        """Return the place with the fused pose of odometry and match, and its covariance.

        None if the two contradict each other, or nothing was matched.

        Parameters
        ----------
        start, covariance
            `base` in the keyframe as odometry has it, (3, 3) in its own frame.
        """
        if self.information is None:
            return None
        off = np.array((self.pose.inverse() @ start).log())
        innovation_covariance = covariance + np.linalg.inv(self.information)
        if off @ np.linalg.solve(innovation_covariance, off) > CONTRADICTS:
            return None
        before = np.linalg.inv(covariance)
        after = np.linalg.inv(before + self.information).astype(np.float64)
        pose = self.pose @ SE2.exp(*(after @ before @ off).tolist())
        return replace(self, pose=pose), after


def known_place(
    new: Keyframe,
    reference: int,
    pose: SE2,
    growing: GrowingMap,
) -> Known | None:
    """Return the keyframe that sees what a new one sees; None: there is none.

    Parameters
    ----------
    new, reference, pose
        A scan, and its pose in a keyframe.
    growing
        The map.
    """
    config, keyframes, back_end = growing
    at, limits = back_end.pose(reference) @ pose, config.tuning.known
    away = np.hypot(*(back_end.poses[:, :2] - (at.x_m, at.y_m)).T)
    near = np.flatnonzero((away < limits.near_m) & certain(back_end.doubts(reference)))
    turn = np.abs(np.angle(np.exp(1j * (back_end.poses[near, 2] - at.theta_rad))))
    for other in near[np.argsort(away[near] + 0.1 * turn)][: limits.tries].tolist():
        old = keyframes[other]
        start = back_end.pose(other).inverse() @ at
        if not old.view.reaches(start.x_m, start.y_m):
            continue
        pair = match_pair(old, new, start, config, limits.match_m)
        there = start if pair is None else pair.pose
        overlap, contradicts = compared(old, new, there)
        is_young = new.travelled_m - old.travelled_m < limits.young_m
        if pair is not None and not config.stretch_m:
            back_end.observe(pair.rms_m)
        if pair is not None and overlap >= config.keyframe_overlap:
            information = pair.information / config.shared
            return Known(other, there, contradicts, is_young, information)
        is_other = contradicts > 1.0 - config.least_agreement and not config.stretch_m
        if is_other and not is_young:
            return Known(other, there, contradicts, is_young)
    return None


def nearest(reference: int, pose: SE2, back_end: BackEnd) -> Known:
    """Return the keyframe nearest to a pose in another one, whatever it sees."""
    at = back_end.pose(reference) @ pose
    away = np.hypot(*(back_end.poses[:, :2] - (at.x_m, at.y_m)).T)
    sure = certain(back_end.doubts(reference))
    number = int(np.argmin(np.where(sure, away, np.inf)))
    return Known(number, back_end.between(number, reference) @ pose, 0.0, is_young=True)


def renewed(new: Keyframe, pose: SE2) -> Keyframe:
    """Return a keyframe with the scan of another, taken at a pose in it."""
    return Keyframe(new.scan.moved(pose), new.travelled_m)


class Probation:
    """Judges a relocalisation by the keyframes that the robot passes.

    Until then the map is left alone: what is not on it may look like what is.
    """

    def __init__(self, config: KnownPlacesConfig) -> None:
        self._config = config
        self._passed = self._against = 0

    def ends_with(self, known: Known | None) -> bool:
        """Count a keyframe that was passed, None where none is; return whether all is clear."""
        self._passed += 1
        self._against += known is None or known.contradicts > self._config.changed
        return self.is_refuted or self._passed >= self._config.confirming_keyframes

    @property
    def is_refuted(self) -> bool:
        """Whether too many keyframes contradict it."""
        return 2 * self._against > self._config.confirming_keyframes


class KnownPlaces:
    """Recognises that a would-be keyframe is of a place that is on the map already.

    Parameters
    ----------
    growing
        The map.
    robot
        State of the robot on it.

    Attributes
    ----------
    renewals
        Number of keyframes that got a new scan.
    is_paused
        Whether the map stays as it is: each scan is of the nearest known place.
    """

    def __init__(self, growing: GrowingMap, robot: RobotState) -> None:
        self._growing = growing
        self._config, self._keyframes, self._back_end = growing
        self._robot = robot
        self._probation: Probation | None = None
        self.renewals = 0
        self.is_paused = False

    @property
    def is_on_probation(self) -> bool:
        """Whether a relocalisation is still to be confirmed."""
        return self._probation is not None

    def begin_probation(self) -> None:
        """Start judging a relocalisation by the keyframes that are passed."""
        self._probation = Probation(self._config.tuning.known)

    def step(self, new: Keyframe, pose: SE2) -> bool:
        """Return whether a scan, at a pose in the last keyframe, is of a known place; stand there.

        The keyframe of a place that has changed gets the scan. Only a live map knows places.
        """
        if not (self._config.is_live or self.is_paused):
            return False
        robot = self._robot
        known, uncertainty = self._find(new, pose)
        is_left_alone = self._config.is_fixed or self.is_paused or self.is_on_probation
        self._judge(known)
        if known is None and is_left_alone:
            known = nearest(robot.place.keyframe, pose, self._back_end)
        if known is None:
            return False
        may_change = robot.travelled_m > robot.unsure_until_m and not is_left_alone
        if (
            known.contradicts > self._config.tuning.known.changed
            and may_change
            and not known.is_young
        ):
            self._keyframes[known.number] = renewed(new, known.pose)
            self.renewals += 1
            robot.trail.redraw()
        robot.pass_keyframe(ScanPose(robot.place.stamp_ns, known.number, known.pose), uncertainty)
        return True

    def _find(self, new: Keyframe, pose: SE2) -> tuple[Known | None, PredictedMotion | None]:
        """Return the known place of a scan, and the uncertainty of the pose in it.

        Stretches are where odometry and match say together; others where the match says, as sure
        as their keyframe.
        """
        robot, config = self._robot, self._config
        last, covariance = robot.place.keyframe, robot.covariance
        own = np.sqrt([[covariance[:2, :2].trace(), covariance[2, 2]]])
        if config.stretch_m and not certain(own)[0]:
            return None, None
        known = known_place(new, last, pose, self._growing)
        if known is None or not config.stretch_m:
            return known, None
        weighed = known.weighed(self._back_end.between(known.number, last) @ pose, covariance)
        if weighed is None:
            return None, None
        known, robot.covariance = weighed
        variances = robot.covariance.diagonal()
        sigma_m, sigma_rad = np.sqrt([variances[:2].mean(), variances[2]]).tolist()
        return known, PredictedMotion(SE2(), sigma_m, sigma_rad)

    def _judge(self, known: Known | None) -> None:
        """Take a keyframe that was passed as a vote on where the robot was found."""
        if self._probation is None or not self._probation.ends_with(known):
            return
        if self._probation.is_refuted:
            self._robot.lose()
        self._probation = None
