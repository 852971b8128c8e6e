"""Looks for the place of a scan on a whole map, piece by piece: none of its steps takes long.

Branch and bound over all headings, in a window around each of the keyframes that cover the map. A
place counts if the match is good, no other place of the map fits nearly as well, and two keyframes
agree with it one by one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from robotctl.estimation.slam.front_end.correlative import Window, search
from robotctl.estimation.slam.front_end.point_to_line import refine
from robotctl.estimation.slam.keyframes.back_end import BackEnd
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.keyframes.keyframe import Keyframe, compared, match_pair
from robotctl.estimation.slam.keyframes.local_map import LocalMap, local_map, thinned
from robotctl.estimation.slam.keyframes.tracker import SEARCH_POINTS
from robotctl.model.geometry.se2 import SE2

_SPACING_M: Final = 1.0
"""Windows lie around keyframes that are this far apart."""
_HALF_M: Final = 1.0
"""Half side of a window: the robot is as far from some keyframe at most."""
_AROUND_M: Final = 2.5
_AROUND: Final = 12
"""Keyframes around that make up the place."""
_LEAST_SCORE: Final = 0.6
_LEAST_INLIERS: Final = 0.6
_AMBIGUOUS: Final = 0.9
"""Another place with this share of the score leaves it open which is right."""
_SAME_M: Final = 0.5
_SAME_RAD: Final = 0.2
_MOVED: Final = 0.08
"""Share of two scans of one place that may contradict: furniture is moved."""
_CLEARLY_MORE: Final = 0.05
_PAIRS: Final = 2
_TRIES: Final = 6


@dataclass(frozen=True, slots=True)
class _Candidate:
    centre: int
    pose: SE2
    score: float


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
    config, keyframes, back_end
        The map; it may grow meanwhile.
    new
        The scan.
    """

    def __init__(
        self, config: KeyframeConfig, keyframes: list[Keyframe], back_end: BackEnd, new: Keyframe
    ) -> None:
        self._config = config
        self._keyframes = keyframes
        self._back_end = back_end
        self._new = new
        self._points = thinned(new.surface.points, SEARCH_POINTS)
        self._poses = back_end.poses[: len(keyframes)]
        self._windows = _cover(self._poses)
        self._candidates: list[_Candidate] = []
        self._best: tuple[_Candidate, _Checked] | None = None
        self._rivals: list[_Candidate] = []
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
        if checked is None or checked.contradicts > _MOVED:
            return False
        self._best = best, checked
        self._rivals = [each for each in self._candidates if each.score > _AMBIGUOUS * best.score]
        return True

    def _search(self, centre: int) -> None:
        """Look for the best place in a window."""
        best = max((each.score for each in self._candidates), default=0.0)
        least = max(_LEAST_SCORE, _AMBIGUOUS * best)
        target, _ = self._local(centre)
        found = search(target.field, self._points, Window(SE2(), _HALF_M, np.pi), least)
        if found is not None:
            self._candidates.append(_Candidate(centre, found.pose, found.score))

    def _is_rivalled(self, rival: _Candidate, best: _Candidate, checked: _Checked) -> bool:
        """Return whether a candidate, or the next best place in its window, may be right as well.

        Not if scans contradict it by more than they do the best.
        """
        T_map_best = self._pose(best.centre) @ best.pose
        off = T_map_best.inverse() @ self._pose(rival.centre) @ rival.pose
        if math.hypot(off.x_m, off.y_m) < _SAME_M and abs(off.theta_rad) < _SAME_RAD:
            target, _ = self._local(rival.centre)
            window = Window(SE2(0.0, 0.0, rival.pose.theta_rad), _HALF_M, np.pi)
            least = _AMBIGUOUS * best.score
            found = search(target.field, self._points, window, least, rival.pose)
            if found is None:
                return False
            rival = _Candidate(rival.centre, found.pose, found.score)
        other = self._check(rival)
        return other is not None and other.contradicts <= 2.0 * checked.contradicts + _CLEARLY_MORE

    def _check(self, candidate: _Candidate) -> _Checked | None:
        """Return the nearest keyframe and the place in it, if scans match one by one."""
        target, around = self._local(candidate.centre)
        match = refine(target.bins, self._new.surface, candidate.pose)
        if match.inliers < _LEAST_INLIERS:
            return None
        at = self._pose(candidate.centre) @ match.pose
        away = np.hypot(*(self._poses[around, :2] - (at.x_m, at.y_m)).T)
        pairs = []
        for other in np.array(around)[np.argsort(away)][:_TRIES].tolist():
            start = self._pose(other).inverse() @ at
            pair = match_pair(self._keyframes[other], self._new, start, self._config, 0.15)
            if pair is not None:
                _, contradicts = compared(self._keyframes[other], self._new, pair.pose)
                pairs.append(_Checked(other, pair.pose, contradicts))
        enough = min(_PAIRS, len(around))
        if len(pairs) < enough:
            return None
        contradicts = sorted(each.contradicts for each in pairs)[enough - 1]
        return replace(pairs[0], contradicts=contradicts)

    def _local(self, centre: int) -> tuple[LocalMap, list[int]]:
        """Return the map around a keyframe, in its frame, and its keyframes."""
        away = np.hypot(*(self._poses[:, :2] - self._poses[centre, :2]).T)
        near = np.argsort(away)
        near = near[away[near] < _AROUND_M]
        # Evenly out of all, so that the window is covered as far as it reaches.
        chosen = near[np.linspace(0, len(near) - 1, min(_AROUND, len(near))).astype(np.int64)]
        own = self._pose(centre).inverse()
        numbers = [int(each) for each in chosen]
        places = [own @ self._pose(each) for each in numbers]
        return local_map([self._keyframes[each] for each in numbers], places), numbers

    def _pose(self, number: int) -> SE2:
        return SE2(*self._poses[number].tolist())


def _cover(poses: np.ndarray) -> list[int]:
    """Return keyframes, none near another of them, and each other one near one of them."""
    chosen: list[int] = []
    left = np.arange(len(poses))
    while len(left):
        chosen.append(int(left[0]))
        away = np.hypot(*(poses[left, :2] - poses[left[0], :2]).T)
        left = left[away >= _SPACING_M]
    return chosen
