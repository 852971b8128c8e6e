"""Search for the place of a scan on the whole map, window by window: no step takes long.

Branch and bound over all headings, in a window around each of the keyframes that cover the map. A
place counts if the match is good, no other place of the map fits nearly as well, and two keyframes
agree with it one by one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from robotctl.estimation.places.recogniser import Candidate
from robotctl.estimation.slam.front_end.correlative import Window, search
from robotctl.estimation.slam.front_end.point_to_line import refine
from robotctl.estimation.slam.front_end.surface import joined
from robotctl.estimation.slam.keyframes.growing_map import GrowingMap
from robotctl.estimation.slam.keyframes.keyframe import Keyframe, compared, match_pair
from robotctl.estimation.slam.keyframes.local_map import LocalMap, map_of, thinned
from robotctl.model.geometry.se2 import SE2


@dataclass(frozen=True, slots=True)
class _Checked:
    number: int
    pose: SE2
    contradicts: float


class MapSearch:
    """A search for one scan.

    Attributes
    ----------
    found
        When it is over: a keyframe, and where `base` was in it; None: not found.

    Parameters
    ----------
    growing
        The map; it may grow meanwhile.
    new
        The scan.
    """

    def __init__(self, growing: GrowingMap, new: Keyframe) -> None:
        config, self._keyframes, back_end = growing
        self._config, self._limits = config, config.tuning.relocalisation
        self._new = new
        self._points = thinned(new.surface.points, config.tuning.tracking.search_points)
        self._poses = back_end.poses[: len(self._keyframes)]
        self._windows = _cover(self._poses, self._limits.spacing_m)
        self._candidates: list[Candidate[int]] = []
        self._best: tuple[Candidate[int], _Checked] | None = None
        self._rivals: list[Candidate[int]] = []
        self.found: tuple[int, SE2] | None = None

    def step(self) -> bool:
        """Search one window; return whether the search is over."""
        if self._windows:
            self._search(self._windows.pop())
            return False
        if self._best is None:
            return not self._has_best()
        if self._rivals:
            return self._is_rivalled(self._rivals.pop(), *self._best)
        self.found = self._best[1].number, self._best[1].pose
        return True

    def _has_best(self) -> bool:
        """Return whether the best candidate is confirmed as a place; list its rivals."""
        if not self._candidates:
            return False
        best = max(self._candidates, key=lambda each: each.score)
        checked = self._check(best)
        if checked is None or checked.contradicts > self._limits.moved:
            return False
        self._best = best, checked
        self._rivals = [
            each for each in self._candidates if each.score > self._limits.ambiguous * best.score
        ]
        return True

    def _search(self, centre: int) -> None:
        """Look for the best place in a window."""
        best = max((each.score for each in self._candidates), default=0.0)
        least = max(self._limits.least_score, self._limits.ambiguous * best)
        target, _ = self._local(centre)
        found = search(target.field, self._points, Window(SE2(), self._limits.half_m, np.pi), least)
        if found is not None:
            self._candidates.append(Candidate(centre, found.pose, found.score))

    def _is_rivalled(self, rival: Candidate[int], best: Candidate[int], checked: _Checked) -> bool:
        """Return whether a candidate, or the next best place in its window, may be right as well.

        Not if scans contradict it by more than they do the best.
        """
        T_map_best = self._pose(best.place) @ best.pose
        off = T_map_best.inverse() @ self._pose(rival.place) @ rival.pose
        if (
            math.hypot(off.x_m, off.y_m) < self._limits.same_m
            and abs(off.theta_rad) < self._limits.same_rad
        ):
            target, _ = self._local(rival.place)
            window = Window(SE2(0.0, 0.0, rival.pose.theta_rad), self._limits.half_m, np.pi)
            least = self._limits.ambiguous * best.score
            found = search(target.field, self._points, window, least, rival.pose)
            if found is None:
                return False
            rival = Candidate(rival.place, found.pose, found.score)
        other = self._check(rival)
        return (
            other is not None
            and other.contradicts <= 2.0 * checked.contradicts + self._limits.clearly_more
        )

    def _check(self, candidate: Candidate[int]) -> _Checked | None:
        """Return the nearest keyframe and the place in it, if scans match one by one."""
        target, around = self._local(candidate.place)
        match = refine(target.bins, self._new.surface, candidate.pose)
        if match.inliers < self._limits.least_inliers:
            return None
        at = self._pose(candidate.place) @ match.pose
        away = np.hypot(*(self._poses[around, :2] - (at.x_m, at.y_m)).T)
        pairs = []
        for other in np.array(around)[np.argsort(away)][: self._limits.tries].tolist():
            start = self._pose(other).inverse() @ at
            pair = match_pair(self._keyframes[other], self._new, start, self._config, 0.15)
            if pair is not None:
                _, contradicts = compared(self._keyframes[other], self._new, pair.pose)
                pairs.append(_Checked(other, pair.pose, contradicts))
        enough = min(self._limits.pairs, len(around))
        if len(pairs) < enough:
            return None
        contradicts = sorted(each.contradicts for each in pairs)[enough - 1]
        return replace(pairs[0], contradicts=contradicts)

    def _local(self, centre: int) -> tuple[LocalMap, list[int]]:
        """Return the map around a keyframe, in its frame, and its keyframes."""
        away = np.hypot(*(self._poses[:, :2] - self._poses[centre, :2]).T)
        near = np.argsort(away)
        near = near[away[near] < self._limits.around_m]
        # Evenly out of all, so that the window is covered as far as it reaches.
        chosen = near[
            np.linspace(0, len(near) - 1, min(self._limits.around, len(near))).astype(np.int64)
        ]
        own = self._pose(centre).inverse()
        numbers = [int(each) for each in chosen]
        seen = [self._keyframes[each].surface.moved(own @ self._pose(each)) for each in numbers]
        return map_of(joined(seen)), numbers

    def _pose(self, number: int) -> SE2:
        return SE2(*self._poses[number].tolist())


def _cover(poses: np.ndarray, spacing_m: float) -> list[int]:
    """Return keyframes so that each one is near one of them, and none near another of them."""
    chosen: list[int] = []
    left = np.arange(len(poses))
    while len(left):
        chosen.append(int(left[0]))
        away = np.hypot(*(poses[left, :2] - poses[left[0], :2]).T)
        left = left[away >= spacing_m]
    return chosen
