"""Loop closure: places that were seen before, found again, and checked before they count."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from robotctl.estimation.slam.front_end.correlative import Window, search
from robotctl.estimation.slam.front_end.point_to_line import refine
from robotctl.estimation.slam.front_end.surface import joined
from robotctl.estimation.slam.keyframes.back_end import BackEnd, Link
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.keyframes.keyframe import Keyframe, match_pair
from robotctl.estimation.slam.keyframes.tracker import local_map, thinned
from robotctl.model.geometry.se2 import SE2

_POINTS: Final = 360
_AROUND: Final = 6
"""Keyframes to each side of an old one that make up the place."""
_AROUND_M: Final = 5.0
_WITH: Final = 4
_WITH_M: Final = 2.0
"""The last keyframes that are looked for together."""
_LEAST_SCORE: Final = 0.45
_LEAST_OF_STRETCHES: Final = 0.75
"""Two walls side by side are in many places."""
_LEAST_INLIERS: Final = 0.5
_AMBIGUOUS: Final = 0.93
"""Another place in the window with this share of the score leaves it open which is right."""
_PAIRS: Final = 3
_APART_M: Final = 0.4
_FORGET_M: Final = 20.0
"""Least and greatest way between two closures that confirm each other."""
_AGREE_M: Final = 0.2
_AGREE_RAD: Final = 0.05
_QUEUE: Final = 6


@dataclass(frozen=True, slots=True)
class Closure:
    """A loop that was looked at.

    Parameters
    ----------
    keyframe, other
        The keyframe of now, and the old one of the place.
    pose
        Of the first in the second, as found.
    score
        Of the search, 0 to 1.
    reason
        Why it does not count; empty: it does.
    """

    keyframe: int
    other: int
    pose: SE2
    score: float
    reason: str


@dataclass(frozen=True, slots=True)
class _Task:
    keyframe: int
    other: int
    sigma_m: float
    sigma_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class _Pending:
    closure: Closure
    links: list[Link]


class LoopSearch:
    """Candidates, one at a time, and what became of them."""

    def __init__(
        self, config: KeyframeConfig, keyframes: list[Keyframe], back_end: BackEnd
    ) -> None:
        self._config = config
        self._keyframes = keyframes
        self._back_end = back_end
        self._tasks: list[_Task] = []
        self._pending: list[_Pending] = []
        self.log: list[Closure] = []

    def consider(self, number: int, others: np.ndarray, doubts: np.ndarray) -> None:
        """Put old keyframes that may be near on the list; the nearest of each visit."""
        others = others[others < number - 2 * _AROUND]
        if len(others) == 0:
            return
        poses = self._back_end.poses
        away = np.hypot(*(poses[others, :2] - poses[number, :2]).T)
        visits = np.split(np.arange(len(others)), np.flatnonzero(np.diff(others) > _AROUND) + 1)
        for visit in visits:
            best = visit[np.argmin(away[visit])]
            self._tasks.append(_Task(number, int(others[best]), *doubts[others[best]].tolist()))
        self._tasks = self._tasks[-_QUEUE:]

    def step(self) -> list[Link]:
        """Look at one candidate; return the links of a loop that is closed."""
        if not self._tasks:
            return []
        task = self._tasks.pop()
        closure, links = self._look(task)
        if not closure.reason:
            links = self._confirmed(_Pending(closure, links))
            if not links:
                closure = Closure(
                    closure.keyframe, closure.other, closure.pose, closure.score,
                    "not confirmed by another yet",
                )  # fmt: skip
        self.log.append(closure)
        return links if not closure.reason else []

    def _look(self, task: _Task) -> tuple[Closure, list[Link]]:
        """Match the last keyframes with an old place."""
        back_end, keyframes, config = self._back_end, self._keyframes, self._config
        k, j = task.keyframe, task.other
        place = [
            each
            for each in range(max(j - _AROUND, 0), min(j + _AROUND + 1, k - 2 * _AROUND))
            if np.hypot(*(back_end.poses[each, :2] - back_end.poses[j, :2])) < _AROUND_M
        ]
        target = local_map([keyframes[e] for e in place], [back_end.between(j, e) for e in place])
        own = [
            each
            for each in range(max(k - _WITH, 0), min(k + _WITH, len(keyframes)))
            if np.hypot(*(back_end.poses[each, :2] - back_end.poses[k, :2])) < _WITH_M
        ]
        surface = joined([keyframes[e].surface.moved(back_end.between(k, e)) for e in own])
        centre = back_end.between(j, k)
        window = Window(
            centre,
            min(3.0 * task.sigma_m + 0.3, 8.0),
            min(3.0 * task.sigma_rad + 0.1, np.pi),
            2.0 * task.sigma_m + 0.2,
            2.0 * task.sigma_rad + 0.1,
        )
        points = thinned(surface.points, _POINTS)
        least = _LEAST_OF_STRETCHES if config.stretch_m else _LEAST_SCORE
        found = search(target.field, points, window, least)
        if found is None:
            return Closure(k, j, centre, 0.0, "low score"), []
        match = refine(target.bins, surface, found.pose)

        def refused(reason: str) -> tuple[Closure, list[Link]]:
            return Closure(k, j, match.pose, found.score, reason), []

        if match.inliers < _LEAST_INLIERS:
            return refused("few echoes match")
        if search(target.field, points, window, _AMBIGUOUS * found.score, found.pose) is not None:
            return refused("ambiguous")
        links = []
        at = match.pose
        by_distance = sorted(
            place,
            key=lambda e: _far(back_end.between(j, e).inverse() @ at),
        )
        for other in by_distance[: 2 * _PAIRS]:
            start = back_end.between(j, other).inverse() @ match.pose
            pair = match_pair(keyframes[other], keyframes[k], start, config, 0.15)
            if pair is None:
                continue
            links.append(Link(other, k, pair.pose, pair.information, is_loop=True))
            if len(links) == _PAIRS:
                break
        if not links:
            return refused("no two scans match")
        return Closure(k, j, match.pose, found.score, ""), links

    def _confirmed(self, new: _Pending) -> list[Link]:
        """Return the links of a closure and of those before that agree with it; else keep it."""
        now = self._keyframes[new.closure.keyframe].travelled_m
        self._pending = [
            each
            for each in self._pending
            if now - self._keyframes[each.closure.keyframe].travelled_m < _FORGET_M
        ]
        links = []
        for each in list(self._pending):
            way_m = abs(now - self._keyframes[each.closure.keyframe].travelled_m)
            if way_m >= _APART_M and self._agree(each.closure, new.closure, way_m):
                links += each.links
                self._pending.remove(each)
        if links:
            return links + new.links
        self._pending.append(new)
        return []

    def _agree(self, a: Closure, b: Closure, way_m: float) -> bool:
        """Return whether two closures mean the same shift of the map."""
        back_end = self._back_end
        expected = back_end.pose(a.other) @ a.pose @ back_end.between(a.keyframe, b.keyframe)
        off = expected.inverse() @ back_end.pose(b.other) @ b.pose
        return (
            bool(np.hypot(off.x_m, off.y_m) < _AGREE_M + 0.02 * way_m)
            and abs(off.theta_rad) < _AGREE_RAD
        )


def _far(pose: SE2) -> float:
    """Return how far a pose is, a turn of a radian for a metre."""
    return float(np.hypot(pose.x_m, pose.y_m) + abs(pose.theta_rad))
