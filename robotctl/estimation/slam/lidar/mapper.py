"""SLAM by lidar, scan by scan: for recorded logs and while driving."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from robotctl.estimation.slam.front_end.point_to_line import Match
from robotctl.estimation.slam.front_end.surface import Floats, Surface, surface_of
from robotctl.estimation.slam.lidar.back_end import BackEnd, Link
from robotctl.estimation.slam.lidar.config import LidarSlamConfig
from robotctl.estimation.slam.lidar.keyframe import Keyframe, keyframe_of, match_pair
from robotctl.estimation.slam.lidar.loops import LoopSearch
from robotctl.estimation.slam.lidar.motion import Expected, by_odometry, by_velocity
from robotctl.estimation.slam.lidar.tracker import LocalMap, Tracked, local_map, track
from robotctl.estimation.slam.robust.kernels import KERNELS
from robotctl.estimation.slam.robust.robust_cost import OFF, scale
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan

LEAST_ECHOES: Final = 10
"""Scans with fewer are not matched."""
_NEAR_M: Final = 3.0
_LOOSE_M: Final = 0.25
_LOOSE_RAD: Final = 0.08
"""Old keyframes with less doubt between are linked where they are; others are loops to close."""
_UNKNOWN: Final = np.diag(1.0 / np.array([0.3, 0.3, 0.2]) ** 2)
"""Information on a motion without odometry, beside that of scans."""
_NEAR_LINKS: Final = 4
_NEAR_TRIES: Final = 8


@dataclass(frozen=True, slots=True)
class Place:
    """Where a scan was taken: a pose of `base` in a keyframe."""

    stamp_ns: int
    keyframe: int
    pose: SE2


class SlamMapper:
    """A map from lidar scans, as they come, with odometry or without.

    Attributes
    ----------
    keyframes, back_end, loops
        Scans that are kept; their poses and links; what became of possible loops.
    epoch
        Counts closed loops, with which poses jump.
    slips, lost, lost_in_a_row
        Scans that contradict odometry; that fit nowhere; of these the last ones.
    covariance
        Of the pose on the map of the last keyframes, (3, 3) in its own frame [m, m, rad].
    """

    def __init__(self, config: LidarSlamConfig | None = None) -> None:
        self.config = config or LidarSlamConfig()
        self.keyframes: list[Keyframe] = []
        self.back_end = BackEnd()
        self.loops = LoopSearch(self.config, self.keyframes, self.back_end)
        self.epoch = 0
        self.slips = self.lost = self.lost_in_a_row = 0
        self.covariance: Floats = 1e-6 * np.eye(3)
        self._local: LocalMap | None = None
        self._place: Place | None = None
        self._odometry: SE2 | None = None
        self._kept_odometry: SE2 | None = None
        self._moved, self._moved_s = SE2(), 0.0
        self._travelled_m = 0.0

    @property
    def pose(self) -> SE2:
        """`base` in `map` at the last scan; the origin before the first."""
        if self._place is None:
            return SE2()
        return self.back_end.pose(self._place.keyframe) @ self._place.pose

    def add(self, scan: RangeScan, odometry: SE2 | None = None) -> Place:
        """Take in a scan, in the order of time, and the pose of `base` in `odom` at its time.

        Raises
        ------
        ValueError
            If the first scan has less than `LEAST_ECHOES` echoes.
        """
        surface = surface_of(scan)
        last = self._place
        if last is None:
            if len(surface.points) < LEAST_ECHOES:
                raise ValueError(
                    f"the first scan has {len(surface.points)} echoes, at least {LEAST_ECHOES} "
                    "are needed"
                )
            self._place = Place(scan.stamp_ns, 0, SE2())
            self._odometry = odometry
            self._new_keyframe(scan, surface, SE2(), None)
            return self._place
        expected = self._expected(scan.stamp_ns, last, odometry)
        tracked = Tracked(last.pose @ expected.motion, None, 0.0, has_slipped=False)
        if len(surface.points) >= LEAST_ECHOES:
            if self._local is None:
                self._local = self._make_local()
            tracked = track(self._local, surface, last.pose, expected, self.config)
        if tracked.has_slipped:
            self.slips += 1
            self._kept_odometry = None
        self._account(tracked.match, expected)
        step = last.pose.inverse() @ tracked.pose
        self._moved, self._moved_s = step, 1e-9 * (scan.stamp_ns - last.stamp_ns)
        self._travelled_m += float(np.hypot(step.x_m, step.y_m))
        self._place = Place(scan.stamp_ns, last.keyframe, tracked.pose)
        if len(surface.points) >= LEAST_ECHOES and self._is_new(tracked):
            self._new_keyframe(scan, surface, tracked.pose, tracked.match)
        links = self.loops.step()
        if links:
            self.close(links)
        return self._place

    def begin_odometry(self) -> None:
        """Take the odometry of the next scan for another one, which begins anew."""
        self._odometry = self._kept_odometry = None

    def _account(self, match: Match | None, expected: Expected) -> None:
        """Count scans that fit nowhere; keep how well the pose on the local map is known."""
        motion = np.diag([expected.sigma_m**2, expected.sigma_m**2, expected.sigma_rad**2])
        if match is None:
            self.lost += 1
            self.lost_in_a_row += 1
            self.covariance += motion
        else:
            self.lost_in_a_row = 0
            both = np.linalg.inv(match.information + expected.information)
            self.covariance = both.astype(np.float64)

    def _expected(self, stamp_ns: int, last: Place, odometry: SE2 | None) -> Expected:
        """Return the motion since the last scan as far as it is known before the match."""
        before, self._odometry = self._odometry, odometry
        if odometry is not None and before is not None:
            return by_odometry(before.inverse() @ odometry)
        return by_velocity(self._moved, self._moved_s, 1e-9 * (stamp_ns - last.stamp_ns))

    def _is_new(self, tracked: Tracked) -> bool:
        """Return whether a scan becomes a keyframe."""
        config, pose = self.config, tracked.pose
        return (
            float(np.hypot(pose.x_m, pose.y_m)) >= config.keyframe_m
            or abs(pose.theta_rad) >= config.keyframe_rad
            or (tracked.match is not None and tracked.match.inliers < config.keyframe_overlap)
        )

    def _make_local(self) -> LocalMap:
        """Return the map of the last keyframes in the frame of the newest."""
        count = len(self.keyframes)
        chosen = range(max(count - self.config.local_keyframes, 0), count)
        return local_map(
            [self.keyframes[each] for each in chosen],
            [self.back_end.between(count - 1, each) for each in chosen],
        )

    def _new_keyframe(
        self,
        scan: RangeScan,
        surface: Surface,
        pose: SE2,
        match: Match | None,
    ) -> None:
        """Keep a scan, seen from the last keyframe at a pose, and link it."""
        number = len(self.keyframes)
        back_end = self.back_end
        self.keyframes.append(keyframe_of(scan, surface, self._travelled_m))
        self._local = None
        self._place = Place(scan.stamp_ns, number, SE2())
        before, self._kept_odometry = self._kept_odometry, self._odometry
        if number == 0:
            back_end.add(pose)
            return
        back_end.add(back_end.pose(number - 1) @ pose)
        # It holds what scans do not see, such as the way along a corridor.
        if before is not None and self._odometry is not None:
            wheels = by_odometry(before.inverse() @ self._odometry)
            back_end.link(Link(number - 1, number, wheels.motion, wheels.information))
        else:
            back_end.link(Link(number - 1, number, pose, _UNKNOWN))
        if self._link_last(number) == 0 and match is not None:
            back_end.link(Link(number - 1, number, pose, match.information))
        self._link_near(number)
        back_end.update()

    def _link_last(self, number: int) -> int:
        """Link a keyframe with the last ones; return how many."""
        count = 0
        for other in range(number - 1, max(number - 1 - self.config.linked_keyframes, -1), -1):
            count += self._link(other, number, 0.15, is_loop=False)
        return count

    def _link(self, first: int, second: int, wide_m: float, *, is_loop: bool) -> bool:
        """Match two keyframes where they are and link them; return whether they match."""
        pair = match_pair(
            self.keyframes[first],
            self.keyframes[second],
            self.back_end.between(first, second),
            self.config,
            wide_m,
        )
        if pair is None:
            return False
        self.back_end.link(Link(first, second, pair.pose, pair.information, is_loop))
        return True

    def _link_near(self, number: int) -> None:
        """Link a keyframe with old ones near it; those that may be near are loops to look for."""
        old = number - self.config.linked_keyframes
        if old <= 0:
            return
        poses = self.back_end.poses
        away = np.hypot(*(poses[:old, :2] - poses[number, :2]).T)
        doubts = self.back_end.doubts(number)
        certain = (doubts[:old, 0] < _LOOSE_M) & (doubts[:old, 1] < _LOOSE_RAD)
        near = np.flatnonzero((away < _NEAR_M) & certain)
        turn = np.abs(np.angle(np.exp(1j * (poses[near, 2] - poses[number, 2]))))
        linked = 0
        for other in near[np.argsort(away[near] + turn)][:_NEAR_TRIES].tolist():
            wide_m = float(np.clip(3.0 * doubts[other, 0], 0.15, 0.5))
            linked += self._link(other, number, wide_m, is_loop=True)
            if linked == _NEAR_LINKS:
                break
        if linked:
            return
        may_be = (away < _NEAR_M + 3.0 * doubts[:old, 0]) & ~certain
        self.loops.consider(number, np.flatnonzero(may_be), doubts)

    def close(self, links: list[Link]) -> None:
        """Close a loop."""
        for link in links:
            self.back_end.link(link)
        self.back_end.update()
        self._reweigh()
        self._local = None
        self.epoch += 1

    def finish(self) -> None:
        """Make the estimate exact, after the last scan."""
        self.back_end.refine()
        self._reweigh()
        self.back_end.refine()

    def _reweigh(self) -> None:
        """Take weight from links of loops that the graph contradicts."""
        back_end = self.back_end
        numbers = [number for number, link in enumerate(back_end.links) if link.is_loop]
        if not numbers:
            return
        weights = KERNELS["dcs"].weight(back_end.squares(numbers), scale(3))
        for number, weight in zip(numbers, weights.tolist(), strict=True):
            if abs(weight - back_end.weights[number]) > OFF:
                back_end.weigh(number, weight)
        back_end.update()
