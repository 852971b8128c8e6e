"""SLAM, scan by scan: for recorded logs and while driving."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from robotctl.estimation.places.visual.features import Features
from robotctl.estimation.slam.front_end.point_to_line import Match
from robotctl.estimation.slam.front_end.surface import Floats, Surface, surface_of
from robotctl.estimation.slam.keyframes.back_end import BackEnd, Link
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.keyframes.keyframe import Keyframe, keyframe_of
from robotctl.estimation.slam.keyframes.known_places import (
    CHANGED,
    Known,
    Probation,
    certain,
    is_borne_out,
    known_place,
    nearest,
    renewed,
)
from robotctl.estimation.slam.keyframes.linking import Linking
from robotctl.estimation.slam.keyframes.loops import LoopSearch
from robotctl.estimation.slam.keyframes.map_search import MapSearch
from robotctl.estimation.slam.keyframes.motion import (
    Expected,
    Kept,
    Place,
    by_odometry,
    by_velocity,
)
from robotctl.estimation.slam.keyframes.saved_map import KeyframeMap
from robotctl.estimation.slam.keyframes.tracker import Tracked, is_new, track
from robotctl.estimation.slam.keyframes.trail import Trail
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan

LEAST_ECHOES: Final = 10
"""Scans with fewer are not matched."""
LOST: Final = 10
"""Number of consecutive scans that fit nowhere after which the robot is lost."""
_UNKNOWN: Final = np.diag(1.0 / np.array([0.3, 0.3, 0.2]) ** 2)
"""Information on a motion without odometry, beside that of scans."""
_RESUMED: Final = Expected(SE2(), 0.5, 0.17)
"""Expected pose of a robot that resumes: it may have rolled on before it came to rest."""
_ASKED: Final = 4
_UNSURE_M: Final = 5.0
"""Way after a slip, or after the robot was found, on which the map's keyframes keep their scans."""
_SURE: Final = 0.6
"""Score of a match that does not follow from where the robot was, at least."""


class SlamMapper:
    """A map from scans, as they come, with odometry or without.

    Attributes
    ----------
    keyframes, back_end, loops
        Scans that are kept; their poses and links; what became of possible loops.
    images
        By keyframe: those by which a camera knows places.
    epoch
        Counts closed loops, with which poses jump.
    slips, lost, lost_in_a_row
        Scans that contradict odometry; that fit nowhere; of these the last ones.
    renewals, found
        Keyframes that got a new scan; how often the robot was found on the map.
    covariance
        Of the pose on the map of the last keyframes, (3, 3) in its own frame [m, m, rad].
    """

    def __init__(self, config: KeyframeConfig | None = None) -> None:
        self.config = config or KeyframeConfig()
        self.keyframes: list[Keyframe] = []
        self.images: dict[int, Features] = {}
        self.back_end = BackEnd(self.config.shared**2)
        self.loops = LoopSearch(self.config, self.keyframes, self.back_end)
        self._linking = Linking(self.config, self.keyframes, self.back_end, self.loops)
        self.epoch = 0
        self.slips = self.lost = self.lost_in_a_row = self.renewals = self.found = 0
        self.covariance: Floats = 1e-6 * np.eye(3)
        self._trail = Trail(self.config, self.keyframes, self.back_end)
        self._place: Place | None = None
        self._resumed = False
        self._by_wheels = True
        """Whether the motion to the last scan was measured."""
        self._unsure_until_m = self._travelled_m = 0.0
        self._probation: Probation | None = None
        self._search: MapSearch | None = None
        self._since_search = SE2()
        self._odometry: SE2 | None = None
        self._kept = Kept()
        self._moved, self._moved_s = SE2(), 0.0

    @property
    def pose(self) -> SE2:
        """`base` in `map` at the last scan; the origin before the first."""
        if self._place is None:
            return SE2()
        return self.back_end.pose(self._place.keyframe) @ self._place.pose

    @property
    def place(self) -> Place:
        """Place of the last scan; before the first, the origin."""
        return self._place or Place(0, 0, SE2())

    @property
    def is_sure(self) -> bool:
        """Whether the robot is on its map and what it passed has borne that out."""
        return not self.is_lost and self._probation is None

    @property
    def is_lost(self) -> bool:
        """Whether so many scans fit nowhere that the robot does not know its place."""
        return self.lost_in_a_row >= LOST

    def resume(self, saved: KeyframeMap, *, is_there: bool) -> None:
        """Go on with a saved map, before the first scan.

        With `is_there`, the robot is expected where it was last; else it may be anywhere.
        """
        self.keyframes += saved.keyframes
        self.images |= saved.images
        self.back_end.load(saved.poses, saved.links, saved.weights)
        self._travelled_m = max(each.travelled_m for each in saved.keyframes)
        self._place = Place(0, *saved.place)
        if not self.config.stretch_m:
            self._trail.begin(saved.place[0])
            self._resumed, self.lost_in_a_row = is_there, LOST

    def go_on(self, place: Place, odometry: SE2, *, is_another: bool) -> None:
        """Start stretches again in the last keyframe: no match would tell where the robot is.

        Parameters
        ----------
        place
            Where the robot is expected.
        odometry
            `base` in `odom` there.
        is_another
            Whether that odometry began since the last scan, perhaps elsewhere.
        """
        known = by_odometry(place.pose, self.config.wheels)
        if is_another:
            known = known.doubted(_RESUMED)
            self._trail.begin()
            self._linking.begin_odometry()
        self._place, self._odometry = place, odometry
        self._kept, self.covariance = Kept(place.pose, odometry, known), known.covariance

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
            self._new_keyframe(keyframe_of(scan, surface, 0.0), SE2(), None)
            return self._place
        expected = self._expected(scan.stamp_ns, last, odometry)
        if self.config.is_live and self.is_lost and not self._resumed:
            return self._look_for(scan, surface, last, expected)
        tracked = self._track(scan, surface, last, expected)
        if tracked.has_slipped:
            self.slips += 1
            self._kept = Kept()
        self._account(tracked.match, expected)
        step = last.pose.inverse() @ tracked.pose
        self._moved, self._moved_s = step, 1e-9 * (scan.stamp_ns - last.stamp_ns)
        self._travelled_m += float(np.hypot(step.x_m, step.y_m))
        self._place = Place(scan.stamp_ns, last.keyframe, tracked.pose)
        if len(surface.points) >= LEAST_ECHOES and is_new(tracked, self.config):
            new = keyframe_of(scan, surface, self._travelled_m)
            if not (self.config.is_live and self._is_known(new, tracked.pose)):
                self._new_keyframe(new, tracked.pose, tracked.match)
        links = self.loops.step()
        if links:
            self.close(links)
        return self._place

    def _track(self, scan: RangeScan, surface: Surface, last: Place, expected: Expected) -> Tracked:
        """Match a scan with the map of the last keyframes."""
        resumed = self._resumed
        nowhere = Tracked(last.pose @ expected.motion, None, 0.0, has_slipped=False)
        if len(surface.points) < LEAST_ECHOES or self.config.stretch_m:
            return nowhere
        self._resumed = False
        tracked = track(self._trail.local, surface, last.pose, expected, self.config)
        follows = self._by_wheels and not tracked.has_slipped and self.lost_in_a_row == 0
        if not self.config.is_live or follows:
            return tracked
        new, asked = keyframe_of(scan, surface, self._travelled_m), self._trail.last(_ASKED)
        at = self.back_end.pose(last.keyframe) @ tracked.pose
        if tracked.score < _SURE or not is_borne_out(
            new, at, [self.keyframes[each] for each in asked], self.back_end.poses[asked]
        ):
            return nowhere
        self._unsure_until_m = self._travelled_m + _UNSURE_M
        return replace(tracked, has_slipped=tracked.has_slipped and not resumed)

    def _look_for(
        self, scan: RangeScan, surface: Surface, last: Place, expected: Expected
    ) -> Place:
        """Take a scan of a robot that is anywhere on the map: `look` looks for it."""
        self._since_search = self._since_search @ expected.motion
        if self._search is None and len(surface.points) >= LEAST_ECHOES:
            new = keyframe_of(scan, surface, self._travelled_m)
            self._search = MapSearch(self.config, self.keyframes, self.back_end, new)
            self._since_search = SE2()
        self._place = Place(scan.stamp_ns, last.keyframe, last.pose @ expected.motion)
        return self._place

    @property
    def looks(self) -> bool:
        """Whether a search for the robot goes on."""
        return self._search is not None

    def look(self) -> bool:
        """Look for a robot that is lost in another piece of the map; return whether it is found."""
        search = self._search
        if search is None or not search.step():
            return False
        self._search = None
        if search.found is None:
            return False
        number, pose = search.found
        self.stand(Place(self.place.stamp_ns, number, pose @ self._since_search), self._odometry)
        self._probation = Probation()
        self.found += 1
        return True

    def stand(self, place: Place, odometry: SE2 | None) -> None:
        """Have the robot be at a place on the map, with `base` in `odom`."""
        self._place, self._odometry = place, odometry
        self._trail.begin(place.keyframe)
        self._kept = Kept(place.pose, odometry)
        self.covariance = 1e-3 * np.eye(3)
        self._unsure_until_m = self._travelled_m + _UNSURE_M
        self.lost_in_a_row = 0

    def _is_known(self, new: Keyframe, pose: SE2) -> bool:
        """Return whether a scan, seen from the last keyframe, is of a known place; be there."""
        last = self.place.keyframe
        known, doubt = self._known(new, pose)
        left_alone = self.config.is_fixed or self._probation is not None
        self._judge(known)
        if known is None and left_alone:
            known = nearest(last, pose, self.back_end)
        if known is None:
            return False
        may_change = self._travelled_m > self._unsure_until_m and not left_alone
        if known.contradicts > CHANGED and may_change and not known.is_young:
            self.keyframes[known.number] = renewed(new, known.pose)
            self.renewals += 1
            self._trail.redraw()
        self._pass(known.number, known.pose, doubt)
        self._place = Place(self.place.stamp_ns, known.number, known.pose)
        return True

    def _known(self, new: Keyframe, pose: SE2) -> tuple[Known | None, Expected | None]:
        """Return the known place of a scan, seen from the last keyframe, and the doubt of it.

        Of stretches it is where odometry and match say; others are where the match says, as sure
        as their keyframe.
        """
        last, covariance = self.place.keyframe, self.covariance
        own = np.sqrt([[covariance[:2, :2].trace(), covariance[2, 2]]])
        if self.config.stretch_m and not certain(own)[0]:
            return None, None
        known = known_place(new, last, pose, self.keyframes, self.back_end, self.config)
        if known is None or not self.config.stretch_m:
            return known, None
        weighed = known.weighed(self.back_end.between(known.number, last) @ pose, covariance)
        if weighed is None:
            return None, None
        known, self.covariance = weighed
        variances = self.covariance.diagonal()
        sigma_m, sigma_rad = np.sqrt([variances[:2].mean(), variances[2]]).tolist()
        return known, Expected(SE2(), sigma_m, sigma_rad)

    def _judge(self, known: Known | None) -> None:
        """Learn more of the place where the robot was found, until it is sure."""
        if self._probation is None or not self._probation.ends_with(known):
            return
        if self._probation.is_refuted:
            self.lost_in_a_row = LOST
        self._probation = None

    def _pass(self, number: int, pose: SE2, doubt: Expected | None = None) -> None:
        """Have a keyframe be the last one that was passed, with the robot at a pose in it."""
        self._trail.add(number)
        self._kept = Kept(pose, self._odometry, doubt)

    def begin_odometry(self) -> None:
        """Start with another odometry at the next scan."""
        self._odometry = self._search = None
        self._kept = Kept()

    def _account(self, match: Match | None, expected: Expected) -> None:
        """Count scans that fit nowhere; keep how well the pose on the local map is known."""
        if match is None:
            self.covariance = self.covariance + expected.covariance
            if not self.config.stretch_m:
                self.lost += 1
                self.lost_in_a_row += 1
        else:
            self.lost_in_a_row = 0
            both = np.linalg.inv(match.information + expected.information)
            self.covariance = both.astype(np.float64)

    def _expected(self, stamp_ns: int, last: Place, odometry: SE2 | None) -> Expected:
        """Return the motion since the last scan as far as it is known before the match."""
        before, self._odometry = self._odometry, odometry
        self._by_wheels = odometry is not None and before is not None and not self._resumed
        if self._resumed:
            return _RESUMED
        if odometry is not None and before is not None:
            return by_odometry(before.inverse() @ odometry, self.config.wheels)
        return by_velocity(self._moved, self._moved_s, 1e-9 * (stamp_ns - last.stamp_ns))

    def _new_keyframe(self, new: Keyframe, pose: SE2, match: Match | None) -> None:
        """Keep a scan, seen from the last keyframe at a pose, and link it."""
        number, last, back_end = len(self.keyframes), self.place.keyframe, self.back_end
        self.keyframes.append(new)
        self._place = Place(new.stamp_ns, number, SE2())
        wheels = self._kept.moved_to(self._odometry, self.config.wheels)
        passed = self._trail.last(self.config.linked_keyframes)
        self._pass(number, SE2())
        if number == 0:
            back_end.add(pose)
            return
        back_end.add(back_end.pose(last) @ pose)
        # It holds what scans do not see, such as the way along a corridor.
        if wheels is not None:
            back_end.link(Link(last, number, wheels.motion, wheels.information))
        else:
            back_end.link(Link(last, number, pose, _UNKNOWN))
        if self._linking.link_last(number, passed) == 0 and match is not None:
            back_end.link(Link(last, number, pose, match.information))
        self.loops.enter(number)
        self._linking.link_near(number, passed, by_wheels=self._by_wheels)
        back_end.update()
        self._come_back()

    def close(self, links: list[Link]) -> None:
        """Close a loop."""
        for link in links:
            self.back_end.link(link)
        self.back_end.update()
        self.back_end.reweigh()
        self._trail.redraw()
        self.epoch += 1
        self._come_back()

    def _come_back(self) -> None:
        """Have stretches be as sure as the last link makes them, if that is of a loop."""
        if self.config.stretch_m and (last := self.back_end.links[-1]).is_loop:
            both = np.linalg.inv(self.covariance) + self.back_end.counted(last)
            self.covariance = np.linalg.inv(both).astype(np.float64)

    def finish(self) -> None:
        """Make the estimate exact, after the last scan."""
        self.back_end.refine()
        self.back_end.reweigh()
        self.back_end.refine()
