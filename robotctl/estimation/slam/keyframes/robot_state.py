"""State of the robot on the map, which the stages of `SlamMapper` share."""

from __future__ import annotations

import numpy as np

from robotctl.estimation.slam.front_end.surface import Floats
from robotctl.estimation.slam.keyframes.back_end import BackEnd
from robotctl.estimation.slam.keyframes.motion import (
    MotionHabit,
    OdometryAnchor,
    PredictedMotion,
    ScanPose,
)
from robotctl.estimation.slam.keyframes.odometry_trust import OdometryTrust
from robotctl.estimation.slam.keyframes.trail import Trail
from robotctl.estimation.slam_tuning import SlamTuning
from robotctl.model.geometry.se2 import SE2


class RobotState:
    """Pose of the robot in a keyframe, and how well it is known.

    Attributes
    ----------
    trail
        Keyframes passed last.
    place
        Place of the last scan; the origin before the first.
    odometry, has_odometry
        `base` in `odom` at the last scan, None if unknown; whether the motion to that scan was
        measured by odometry that is believed.
    anchor
        Pose that odometry continues from, for the link to the next keyframe.
    covariance
        Covariance (3, 3) of the pose on the map of the last keyframes, in its own frame
        [m, m, rad].
    travelled_m, unmeasured_m
        Distance travelled so far, and the part of it without odometry [m].
    unsure_until_m
        Travelled distance up to which the keyframes of the map keep their scans [m].
    measured, trust
        Motion to the last scan by odometry, None if unknown; whether odometry is believed.
    habit
        Motion expected without odometry.
    unmatched_in_a_row
        Number of unmatched scans since the last match.
    is_resumed
        Whether the next scan is the first one on a saved map, near the robot's last place.
    """

    def __init__(self, config: SlamTuning, trail: Trail) -> None:
        self._config = config.tracking
        self.trail = trail
        self.place = ScanPose(0, 0, SE2())
        self.odometry: SE2 | None = None
        self.has_odometry = True
        self.anchor = OdometryAnchor()
        self.covariance: Floats = 1e-6 * np.eye(3)
        self.travelled_m = self.unmeasured_m = self.unsure_until_m = 0.0
        self.habit = MotionHabit(config.tracking.velocity_factor)
        self.trust = OdometryTrust(config.trust)
        self.measured: PredictedMotion | None = None
        self.unmatched_in_a_row = 0
        self.is_resumed = False

    @property
    def is_lost(self) -> bool:
        """Whether so many scans went unmatched that the robot does not know its place."""
        return self.unmatched_in_a_row >= self._config.lost_scans

    def lose(self) -> None:
        """Count as lost until a scan matches."""
        self.unmatched_in_a_row = self._config.lost_scans

    def begin_odometry(self) -> None:
        """Start with another odometry at the next scan."""
        self.odometry = None
        self.anchor = OdometryAnchor()
        self.trust.begin()

    def advance(self, stamp_ns: int, pose: SE2, *, is_seen: bool) -> None:
        """Stand at a pose in the present keyframe, that a scan has seen or that is expected."""
        last, self.place = self.place, ScanPose(stamp_ns, self.place.keyframe, pose)
        step = last.pose.inverse() @ pose
        if is_seen:
            self.habit.learn(step, 1e-9 * (stamp_ns - last.stamp_ns))
        else:
            self.habit.forget()
        length_m = float(np.hypot(step.x_m, step.y_m))
        self.travelled_m += length_m
        self.unmeasured_m += 0.0 if self.has_odometry else length_m

    def pass_keyframe(self, place: ScanPose, uncertainty: PredictedMotion | None = None) -> None:
        """Stand in a keyframe, from where odometry leads on; its uncertainty is added to that."""
        self.place = place
        self.trail.add(place.keyframe)
        odometry = self.odometry if self.trust.is_trusted else None
        self.anchor = OdometryAnchor(place.pose, odometry, uncertainty)

    def relocate(self, place: ScanPose, odometry: SE2 | None) -> None:
        """Stand at another place of the map, with `base` in `odom` there."""
        self.place, self.odometry = place, odometry
        self.trail.begin(place.keyframe)
        self.anchor = OdometryAnchor(place.pose, odometry)
        self.covariance = 1e-3 * np.eye(3)
        self.keep_keyframes()
        self.unmatched_in_a_row = 0

    def keep_keyframes(self) -> None:
        """Leave the scans of keyframes as they are on the next metres: the place is not sure."""
        self.unsure_until_m = self.travelled_m + self._config.unsure_m

    def fuse_loop(self, back_end: BackEnd) -> None:
        """Fuse the last link with the covariance of the pose, if it is one of a loop."""
        last = back_end.links[-1]
        if last.is_loop:
            both = np.linalg.inv(self.covariance) + back_end.counted(last)
            self.covariance = np.linalg.inv(both).astype(np.float64)
