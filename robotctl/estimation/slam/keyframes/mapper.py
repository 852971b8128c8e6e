"""SLAM, scan by scan: for recorded logs and while driving.

`SlamMapper.add` is the table of contents of this package: it names the stages in the order in which
a scan passes them, each of them a file beside this one.
"""

from __future__ import annotations

import numpy as np

from robotctl.estimation.places.visual.features import Features
from robotctl.estimation.slam.front_end.surface import Floats, Surface
from robotctl.estimation.slam.keyframes.back_end import BackEnd, KeyframeLink
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.keyframes.growing_map import GrowingMap
from robotctl.estimation.slam.keyframes.insertion import KeyframeInsertion
from robotctl.estimation.slam.keyframes.keyframe import Keyframe, surface_at_hand
from robotctl.estimation.slam.keyframes.known_places import KnownPlaces
from robotctl.estimation.slam.keyframes.linking import Linking
from robotctl.estimation.slam.keyframes.loops import LoopSearch
from robotctl.estimation.slam.keyframes.motion import (
    AFTER_A_BREAK,
    OdometryAnchor,
    ScanPose,
    by_odometry,
)
from robotctl.estimation.slam.keyframes.prediction import MotionPrediction
from robotctl.estimation.slam.keyframes.relocaliser import Relocaliser
from robotctl.estimation.slam.keyframes.robot_state import RobotState
from robotctl.estimation.slam.keyframes.saved_map import KeyframeMap
from robotctl.estimation.slam.keyframes.tracker import LEAST_ECHOES, Tracker, new_keyframe
from robotctl.estimation.slam.keyframes.trail import Trail
from robotctl.model.geometry.points import rotation
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan


class SlamMapper:
    """A map from scans, as they come, with odometry or without.

    Attributes
    ----------
    keyframes, back_end, growing
        Scans that are kept; their poses and the links between them; both with the settings.
    images
        Images by which a camera recognises places, by keyframe.
    robot
        State of the robot on the map.
    tracker, known_places, loops, relocaliser
        Stages of `add`.
    epoch
        Number of closed loops, with which poses jump.
    """

    def __init__(self, config: KeyframeConfig | None = None) -> None:
        self.config = config = config or KeyframeConfig()
        self.keyframes: list[Keyframe] = []
        self.images: dict[int, Features] = {}
        self.back_end = BackEnd(config.shared**2)
        self.growing = growing = GrowingMap(config, self.keyframes, self.back_end)
        self.robot = RobotState(config.tuning, Trail(growing))
        self._prediction = MotionPrediction(config, self.robot)
        self.tracker = Tracker(growing, self.robot)
        self.known_places = KnownPlaces(growing, self.robot)
        self.loops = LoopSearch(growing)
        self._linking = Linking(growing, self.loops)
        self._insertion = KeyframeInsertion(growing, self.robot, self._linking)
        self.relocaliser = Relocaliser(growing, self.robot)
        self.epoch = 0

    def add(self, scan: RangeScan, odometry: SE2 | None = None) -> ScanPose:
        """Take in a scan, in the order of time, and the pose of `base` in `odom` at its time.

        Raises
        ------
        ValueError
            If the first scan has fewer than `LEAST_ECHOES` echoes.
        """
        surface = surface_at_hand(scan)  # pre-process
        if not self.keyframes:
            return self._begin(scan, surface, odometry)
        predicted = self._prediction.step(scan.stamp_ns, odometry)
        if self.config.is_live and self.is_lost and not self.robot.is_resumed:
            self.relocaliser.add(scan, surface, predicted)  # `relocalise` searches the whole map
            return self.place
        tracked = self.tracker.step(scan, surface, predicted)  # register
        new = new_keyframe(scan, surface, tracked, self.robot.travelled_m, self.config)
        if new is not None and not self.known_places.step(new, tracked.pose):
            self._insertion.step(new, tracked.pose, tracked.match)  # link and optimise
        if not self.is_paused:
            self.close(self.loops.step())
        return self.place

    def _begin(self, scan: RangeScan, surface: Surface, odometry: SE2 | None) -> ScanPose:
        """Make the first scan the keyframe at the origin of the map."""
        if len(surface.points) < LEAST_ECHOES:
            raise ValueError(
                f"the first scan has {len(surface.points)} echoes, at least {LEAST_ECHOES} "
                "are needed"
            )
        self.robot.odometry = odometry
        self._insertion.step(Keyframe(scan, 0.0), SE2(), None)
        return self.place

    def close(self, links: list[KeyframeLink]) -> None:
        """Close a loop by its links, if there are any, and optimise the graph."""
        if not links:
            return
        self.back_end.close(links)
        self.epoch += 1
        self.robot.trail.redraw()
        if self.config.stretch_m:
            self.robot.fuse_loop(self.back_end)

    def relocalise(self) -> bool:
        """Search one more window of the map for a lost robot; return whether it was found."""
        if not self.relocaliser.step():
            return False
        self.known_places.begin_probation()
        return True

    @property
    def is_paused(self) -> bool:
        """Whether the map stays as it is: scans only localise."""
        return self.known_places.is_paused

    @is_paused.setter
    def is_paused(self, is_paused: bool) -> None:
        self.known_places.is_paused = is_paused

    @property
    def place(self) -> ScanPose:
        """Place of the last scan; before the first, the origin."""
        return self.robot.place

    @property
    def pose(self) -> SE2:
        """`base` in `map` at the last scan; the origin before the first."""
        if not self.keyframes:
            return SE2()
        return self.back_end.pose(self.place.keyframe) @ self.place.pose

    @property
    def covariance(self) -> Floats:
        """Covariance (3, 3) of the pose in `map`, in its own frame [m, m, rad].

        That of the place in the keyframe, and that of the keyframe; a fixed map is right as it is.
        """
        robot, own = self.robot, self.robot.covariance
        by_wheels = robot.anchor.moved_to(robot.odometry, self.config.wheels)
        if self.config.stretch_m and by_wheels is not None:
            own = by_wheels.covariance  # a stretch lies along the odometry from the keyframe on
        if self.config.is_fixed or not self.keyframes:
            return own
        # The keyframe's error as the robot has it: K exp(e) p = K p exp(A e), A = Ad(1/p).
        back = robot.place.pose.inverse()
        A = np.eye(3)
        A[:2, :2] = rotation(back.theta_rad).T
        A[:2, 2] = back.y_m, -back.x_m
        marginal = self.back_end.variance_factor * self.back_end.marginal(robot.place.keyframe)
        return A @ marginal @ A.T + own

    @property
    def is_lost(self) -> bool:
        """Whether so many scans went unmatched that the robot does not know its place."""
        return self.robot.is_lost

    @property
    def is_sure(self) -> bool:
        """Whether the robot is on its map and the keyframes passed since have confirmed that."""
        return not self.is_lost and not self.known_places.is_on_probation

    def resume(self, saved: KeyframeMap, *, is_there: bool) -> None:
        """Continue a saved map, before the first scan.

        With `is_there`, the robot is expected at its last place; else it may be anywhere.
        """
        self.keyframes += saved.keyframes
        self.images |= saved.images
        self.back_end.load(saved.poses, saved.links, saved.weights)
        robot = self.robot
        robot.travelled_m = max(each.travelled_m for each in saved.keyframes)
        robot.place = ScanPose(0, *saved.place)
        if not self.config.stretch_m:
            robot.trail.begin(saved.place[0])
            robot.is_resumed = is_there
            robot.lose()

    def restart_segment(self, place: ScanPose, odometry: SE2, *, is_another: bool) -> None:
        """Start a new odometry segment at the last keyframe: stretches have no match there.

        Parameters
        ----------
        place
            Expected place of the robot.
        odometry
            `base` in `odom` there.
        is_another
            Whether that odometry began after the last scan, perhaps elsewhere.
        """
        robot = self.robot
        known = by_odometry(place.pose, self.config.wheels)
        if is_another:
            known = known.widened(AFTER_A_BREAK)
            robot.trail.begin()
            self._linking.begin_odometry()
        robot.place, robot.odometry = place, odometry
        robot.anchor = OdometryAnchor(place.pose, odometry, known)
        robot.covariance = known.covariance

    def begin_odometry(self) -> None:
        """Start with another odometry at the next scan."""
        self.robot.begin_odometry()
        self.relocaliser.reset()

    def finish(self) -> None:
        """Make the estimate exact, after the last scan."""
        self.back_end.finish()
