"""Loop closure: places that were seen before, found again, and checked before they count."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final, Literal, TypeAlias

import numpy as np

from robotctl.estimation.slam.front_end.correlative import Window, search
from robotctl.estimation.slam.front_end.point_to_line import refine
from robotctl.estimation.slam.front_end.surface import Surface, joined
from robotctl.estimation.slam.keyframes.back_end import BackEnd, Link, certain
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.keyframes.keyframe import CORRIDOR, Keyframe, held, match_pair
from robotctl.estimation.slam.keyframes.local_map import local_map, thinned
from robotctl.estimation.slam.keyframes.shapes import AROUND, PossiblePlaces, Shapes
from robotctl.model.geometry.se2 import SE2

FoundBy: TypeAlias = Literal["position", "shape", "image", "sonar turn"]

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
_PAIR_M: Final = 0.15
_APART_M: Final = 0.4
_FORGET_M: Final = 20.0
"""Least and greatest way between two closures that confirm each other."""
_AGREE_M: Final = 0.2
_AGREE_RAD: Final = 0.05
_QUEUE: Final = 6
NEAR_M: Final = 3.0
"""Keyframes so far apart may see the same."""
_GATE: Final = 3.0
"""Standard deviations of the map's doubt within which a place is looked for."""
_BEYOND: Final = 2.0
"""Factor on the uncertainty within which places may look alike: the covariance is a guess."""
_SLIPS: Final = 0.2
"""Slip as a share of the way: without odometry, scans slip along bare walls unnoticed."""
_APART_ALIKE_M: Final = 2.0
"""Least way between two that confirm each other by appearance alone: rooms look alike."""
_ALIKE: Final = 2
"""Keyframes of like shape that are looked at, for each new one."""
_LEAST_ALIKE: Final = 0.65
_SHAPE_M: Final = 1.5
_SHAPE_RAD: Final = 0.35
"""How far from a place of like shape the robot may be."""
_AT_ONCE: Final = 8
"""Shapes of a loaded map that are taken in with each new keyframe."""


@dataclass(frozen=True, slots=True)
class Closure:
    """A loop that was looked at.

    Parameters
    ----------
    keyframe, other
        The keyframe of now, and the old one of the place.
    found_by
        What spoke for the place.
    pose
        Of the first in the second, as found.
    score
        Of the search, 0 to 1.
    reason
        Why it does not count; empty: it does.
    """

    keyframe: int
    other: int
    found_by: FoundBy
    pose: SE2
    score: float
    reason: str


@dataclass(frozen=True, slots=True)
class Candidate:
    """An old place that a keyframe may be at.

    Parameters
    ----------
    keyframe, other
        The keyframe of now, and the old one of the place.
    found_by
        What speaks for it.
    shift_m, turn_rad
        Where to look: so far to each side of `pose` [m], [rad].
    pose
        Of the first in the second; None: as the map has it when it is looked at.
    sigma_m, sigma_rad
        Standard deviations of that [m], [rad]; inf: all of it is equally likely.
    limit_m
        How far the map may be wrong there [m].
    """

    keyframe: int
    other: int
    found_by: FoundBy
    shift_m: float
    turn_rad: float
    pose: SE2 | None = None
    sigma_m: float = math.inf
    sigma_rad: float = math.inf
    limit_m: float = math.inf


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
        self._near: list[Candidate] = []
        self._alike: list[Candidate] = []
        self._alike_is_next = True
        self._pending: list[_Pending] = []
        self._shapes = Shapes()
        self.log: list[Closure] = []

    def enter(self, number: int) -> None:
        """Take in the shape of a new keyframe, and of some of a map that was loaded."""
        between = self._back_end.between
        for new in range(len(self._shapes), number + 1)[:_AT_ONCE]:
            around = range(max(new - AROUND, 0), new + 1)
            self._shapes.add(
                [(between(new, each), self._keyframes[each].surface.points) for each in around]
            )

    def consider(
        self, number: int, others: np.ndarray, doubts: np.ndarray, *, has_odometry: bool
    ) -> None:
        """Put old keyframes on the list: the nearest of each visit, and those that look alike.

        Parameters
        ----------
        number
            Of the new keyframe.
        others
            Old ones whose place beside it is in doubt, (n,).
        doubts
            Of all keyframes: standard deviations of position [m] and heading [rad], (m, 2).
        has_odometry
            Whether there is odometry.
        """
        others = others[others < number - 2 * _AROUND]
        poses = self._back_end.poses
        away = np.hypot(*(poses[others, :2] - poses[number, :2]).T)
        reach = _GATE * doubts[others, 0]
        is_near = away < NEAR_M + reach
        self._consider_near(number, others[is_near], away[is_near], doubts)
        limits_m = _BEYOND * reach
        if not has_odometry:
            ways_m = np.array([self._keyframes[each].travelled_m for each in others])
            way_m = np.abs(self._keyframes[number].travelled_m - ways_m)
            limits_m = np.maximum(limits_m, _SLIPS * way_m)
        is_known = (others < len(self._shapes)) & (number < len(self._shapes))
        may_be = np.flatnonzero(is_known & (away < NEAR_M + limits_m))
        turns = poses[number, 2] - poses[others, 2]
        within = _SHAPE_RAD + _BEYOND * _GATE * doubts[others, 1]
        possible = PossiblePlaces(others[may_be], turns[may_be], within[may_be])
        limits = dict(zip(others.tolist(), limits_m.tolist(), strict=True))
        for each in reversed(self._shapes.alike(number, possible, _ALIKE, _AROUND)):
            if each.score > _LEAST_ALIKE:
                self._put(
                    Candidate(
                        number, each.number, "shape", _SHAPE_M, _SHAPE_RAD,
                        SE2(0.0, 0.0, each.turn_rad), limit_m=_SHAPE_M + limits[each.number],
                    )
                )  # fmt: skip

    def suggest(self, candidate: Candidate) -> None:
        """Put a place that was recognised on the list, unless the map knows that already.

        An image tells a place from all others; by sound the map may be no more wrong than by shape.
        """
        if candidate.other >= candidate.keyframe - 2 * _AROUND:
            return
        doubts = self._back_end.doubts(candidate.keyframe)
        if certain(doubts)[candidate.other]:
            return
        if candidate.found_by != "image":
            limit_m = _BEYOND * _GATE * float(doubts[candidate.other, 0]) + candidate.shift_m
            candidate = replace(candidate, limit_m=limit_m)
        self._put(candidate)

    def _put(self, candidate: Candidate) -> None:
        """Put a place that looks or sounds alike on the list."""
        self._alike = [*self._alike, candidate][-_QUEUE:]

    def _consider_near(
        self, number: int, others: np.ndarray, away: np.ndarray, doubts: np.ndarray
    ) -> None:
        """Put old keyframes that may be near on the list; the nearest of each visit."""
        if len(others) == 0:
            return
        visits = np.split(np.arange(len(others)), np.flatnonzero(np.diff(others) > _AROUND) + 1)
        for visit in visits:
            other = int(others[visit[np.argmin(away[visit])]])
            sigma_m, sigma_rad = doubts[other].tolist()
            self._near.append(
                Candidate(
                    number, other, "position",
                    min(_GATE * sigma_m + 0.3, 8.0), min(_GATE * sigma_rad + 0.1, math.pi),
                    sigma_m=2.0 * sigma_m + 0.2, sigma_rad=2.0 * sigma_rad + 0.1,
                )
            )  # fmt: skip
        self._near = self._near[-_QUEUE:]

    def step(self) -> list[Link]:
        """Look at one candidate; return the links of a loop that is closed."""
        if not self._near and not self._alike:
            return []
        # By turns, so that neither kind waits for the other.
        self._alike_is_next = bool(self._alike) and (self._alike_is_next or not self._near)
        candidate = self._alike.pop() if self._alike_is_next else self._near.pop()
        self._alike_is_next = not self._alike_is_next
        closure, links = self._look(candidate)
        if not closure.reason:
            links = self._confirmed(_Pending(closure, links))
            if not links:
                closure = replace(closure, reason="not confirmed by another yet")
        self.log.append(closure)
        return links if not closure.reason else []

    def _look(self, candidate: Candidate) -> tuple[Closure, list[Link]]:
        """Match the last keyframes with an old place."""
        back_end, keyframes = self._back_end, self._keyframes
        k, j, found_by = candidate.keyframe, candidate.other, candidate.found_by
        place = self._around(j, range(max(j - _AROUND, 0), min(j + _AROUND + 1, k - 2 * _AROUND)))
        target = local_map([keyframes[e] for e in place], [back_end.between(j, e) for e in place])
        surface = self._last_ones(k)
        expected = back_end.between(j, k)
        window = Window(
            candidate.pose or expected, candidate.shift_m, candidate.turn_rad,
            candidate.sigma_m, candidate.sigma_rad,
        )  # fmt: skip
        points = thinned(surface.points, _POINTS)
        least = _LEAST_OF_STRETCHES if self._config.stretch_m else _LEAST_SCORE
        found = search(target.field, points, window, least)
        if found is None:
            return Closure(k, j, found_by, window.centre, 0.0, "low score"), []
        match = refine(target.bins, surface, found.pose)
        pose = match.pose
        if self._config.stretch_m:
            pose = held(match, expected, CORRIDOR)
        closure = Closure(k, j, found_by, pose, found.score, "")
        off = expected.inverse() @ pose
        if match.inliers < _LEAST_INLIERS:
            return replace(closure, reason="few echoes match"), []
        if math.hypot(off.x_m, off.y_m) > candidate.limit_m:
            return replace(closure, reason="too far off"), []
        if search(target.field, points, window, _AMBIGUOUS * found.score, found.pose) is not None:
            return replace(closure, reason="ambiguous"), []
        links = self._pairs(k, j, place, pose)
        return (closure, links) if links else (replace(closure, reason="no two scans match"), [])

    def _around(self, centre: int, among: range, within_m: float = _AROUND_M) -> list[int]:
        """Return keyframes that are near one."""
        poses = self._back_end.poses
        return [e for e in among if np.hypot(*(poses[e, :2] - poses[centre, :2])) < within_m]

    def _last_ones(self, number: int) -> Surface:
        """Return what a keyframe and those before and after it see, in its frame."""
        among = range(max(number - _WITH, 0), min(number + _WITH, len(self._keyframes)))
        between = self._back_end.between
        return joined(
            [
                self._keyframes[each].surface.moved(between(number, each))
                for each in self._around(number, among, _WITH_M)
            ]
        )

    def _pairs(self, k: int, j: int, place: list[int], at: SE2) -> list[Link]:
        """Return links of a keyframe, seen from `j`, with those of the place that match it."""
        between, links = self._back_end.between, []
        starts = {other: between(j, other).inverse() @ at for other in place}
        keyframes, new = self._keyframes, self._keyframes[k]
        by_overlap = sorted(
            place, key=lambda each: keyframes[each].sees(new, starts[each]), reverse=True
        )
        for other in by_overlap[: 2 * _PAIRS]:
            pair = match_pair(keyframes[other], new, starts[other], self._config, _PAIR_M)
            if pair is not None:
                links.append(Link(other, k, pair.pose, pair.information, is_loop=True))
            if len(links) == _PAIRS:
                break
        return links

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
            is_near = "position" in (each.closure.found_by, new.closure.found_by)
            apart_m = _APART_M if is_near else _APART_ALIKE_M
            if way_m >= apart_m and self._agree(each.closure, new.closure, way_m):
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
