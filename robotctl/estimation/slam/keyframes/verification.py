"""Verification of a candidate place: scans must fit it well, there only, and one by one.

Whatever suggests a place, this decides whether the robot can be there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from robotctl.estimation.slam.front_end.correlative import Window
from robotctl.estimation.slam.front_end.surface import Surface
from robotctl.estimation.slam.keyframes.back_end import KeyframeLink
from robotctl.estimation.slam.keyframes.candidates import POSITION, LoopCandidate
from robotctl.estimation.slam.keyframes.growing_map import GrowingMap
from robotctl.estimation.slam.keyframes.keyframe import CORRIDOR, held, match_pair
from robotctl.estimation.slam.keyframes.local_map import map_of, thinned
from robotctl.model.geometry.se2 import SE2


@dataclass(frozen=True, slots=True)
class Closure:
    """A loop that was looked at.

    Parameters
    ----------
    keyframe, other
        The keyframe of now, and the old one of the place.
    found_by
        Name of what suggested the place.
    pose
        Pose of the first in the second, as found.
    score
        Score of the search, 0 to 1.
    reason
        Why it does not count; empty: it does.
    """

    keyframe: int
    other: int
    found_by: str
    pose: SE2
    score: float
    reason: str


class Verifier:
    """Matches the last keyframes with those around an old one.

    Parameters
    ----------
    growing
        The map.
    """

    def __init__(self, growing: GrowingMap) -> None:
        self._growing = growing
        self._config, self._keyframes, self._back_end = growing
        self._limits = growing.config.tuning.verification

    def verify(self, candidate: LoopCandidate) -> tuple[Closure, list[KeyframeLink]]:
        """Return what became of a candidate, and the links of a loop where scans confirm it."""
        limits, k, j = self._limits, candidate.keyframe, candidate.place
        place = self._place(j, k)
        target = map_of(self._growing.surface(place, j))
        surface, expected = self._recent(k), self._back_end.between(j, k)
        window = Window(
            expected if candidate.found_by == POSITION else candidate.pose,
            candidate.shift_m, candidate.turn_rad, candidate.sigma_m, candidate.sigma_rad,
        )  # fmt: skip
        points = thinned(surface.points, limits.points)
        is_gathered = self._config.stretch_m > 0.0
        least = limits.least_score_stretches if is_gathered else limits.least_score
        fit = target.fit(surface, points, window, least)
        if fit is None:
            return Closure(k, j, candidate.found_by, window.centre, 0.0, "low score"), []
        pose = held(fit.match, expected, CORRIDOR) if is_gathered else fit.match.pose
        closure = Closure(k, j, candidate.found_by, pose, fit.score, "")
        off = expected.inverse() @ pose
        if fit.match.inliers < limits.least_inliers:
            return replace(closure, reason="few echoes match"), []
        if math.hypot(off.x_m, off.y_m) > candidate.limit_m:
            return replace(closure, reason="too far off"), []
        if target.rival(points, window, limits.ambiguous, fit) is not None:
            return replace(closure, reason="ambiguous"), []
        links = matching_pairs(self._growing, place, j, k, pose)
        return (closure, links) if links else (replace(closure, reason="no two scans match"), [])

    def _place(self, centre: int, before: int) -> list[int]:
        """Return the keyframes around an old one, long before another."""
        around = self._limits.around
        among = range(max(centre - around, 0), min(centre + around + 1, before - 2 * around))
        return self._near(centre, among, self._limits.around_m)

    def _near(self, centre: int, among: range, within_m: float) -> list[int]:
        """Return keyframes that are near one."""
        poses = self._back_end.poses
        return [e for e in among if np.hypot(*(poses[e, :2] - poses[centre, :2])) < within_m]

    def _recent(self, number: int) -> Surface:
        """Return what a keyframe and those before and after it see, in its frame."""
        recent = self._limits.recent
        among = range(max(number - recent, 0), min(number + recent, len(self._keyframes)))
        near = self._near(number, among, self._limits.recent_m)
        return self._growing.surface(near, number)


def matching_pairs(
    growing: GrowingMap, place: Sequence[int], centre: int, number: int, pose: SE2
) -> list[KeyframeLink]:
    """Return links of a keyframe, at a pose in one, with those of the place that match it."""
    config, keyframes, back_end = growing
    new, limits = keyframes[number], config.tuning.verification
    starts = {other: back_end.between(centre, other).inverse() @ pose for other in place}
    by_overlap = sorted(
        place, key=lambda each: keyframes[each].sees(new, starts[each]), reverse=True
    )
    links: list[KeyframeLink] = []
    for other in by_overlap[: 2 * limits.pairs]:
        pair = match_pair(keyframes[other], new, starts[other], config, limits.pair_m)
        if pair is not None:
            links.append(KeyframeLink(other, number, pair.pose, pair.information, is_loop=True))
        if len(links) == limits.pairs:
            break
    return links
