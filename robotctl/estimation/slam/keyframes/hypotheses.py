"""Registration where nothing but scans tells the motion: all places that fit, and the best of them.

The search alone prefers no motion along a corridor, where all of a scan overlaps with the map, and
cannot tell a corner from itself turned by 90 degrees. So places that fit nearly as well are kept,
and ranked by what the last keyframes and the scan say of each other: a beam that goes through a
wall of the other tells two places apart that look alike.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from robotctl.estimation.slam.front_end.correlative import Window, search
from robotctl.estimation.slam.front_end.point_to_line import Match, refine, share_on_map
from robotctl.estimation.slam.front_end.surface import Surface
from robotctl.estimation.slam.keyframes.keyframe import (
    CORRIDOR,
    LOOSE,
    Keyframe,
    each_of_other,
    is_corridor,
)
from robotctl.estimation.slam.keyframes.local_map import LocalMap, thinned
from robotctl.estimation.slam.keyframes.motion import (
    SURPRISE_M,
    SURPRISE_RAD,
    PredictedMotion,
)
from robotctl.estimation.slam.keyframes.registration import refined
from robotctl.estimation.slam_tuning import HypothesisConfig, TrackingConfig
from robotctl.model.geometry.se2 import SE2

_SAME_M: Final = 0.25
_SAME_RAD: Final = 0.15
"""Matches nearer than this are of one place [m], [rad]."""

_COARSE: Final = 1
"""Level of the blocks of poses that are refined: 0.1 m by two turns."""

_SURPRISE: Final = np.array([SURPRISE_M, SURPRISE_M, SURPRISE_RAD])


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """A place of a scan on a local map.

    Parameters
    ----------
    match
        Pose of `base` and how well it is known.
    score
        Score of the search there, 0 to 1.
    worth
        Plausibility, beside other hypotheses for the same scan; about 1 where all fits.
    evidence
        The same without the expectation, and without what lies beyond the last keyframe's view.
    """

    match: Match
    score: float
    worth: float
    evidence: float


class Sight(NamedTuple):
    """A scan, and all that tells where it may be.

    Parameters
    ----------
    local, new, walls
        Map of the last keyframes, the scan as it would be a keyframe, and its `Surface.walls`.
    seen
        Last keyframes and their poses on that map, which the scan must not contradict.
    prior, predicted
        Expected pose, and the motion that led there.
    """

    local: LocalMap
    new: Keyframe
    walls: Surface
    seen: Sequence[tuple[Keyframe, SE2]]
    prior: SE2
    predicted: PredictedMotion


class HypothesisSearch:
    """Finds the places of a scan on a local map without odometry.

    Parameters
    ----------
    tracking, limits
        Thresholds.
    """

    def __init__(self, tracking: TrackingConfig, limits: HypothesisConfig) -> None:
        self._tracking, self._limits = tracking, limits

    def step(self, sight: Sight) -> list[Hypothesis]:
        """Return places of a scan, the most plausible first; at least one."""
        limits = self._limits
        last = sight.prior @ sight.predicted.motion.inverse()
        found = self._within(sight, Window(last, limits.near_m, limits.near_rad, level=_COARSE))
        if found[0].worth < limits.sure_worth:
            far = Window(last, limits.far_m, limits.far_rad, level=_COARSE)
            found += self._within(sight, far)
            found.sort(key=lambda each: -each.worth)
        return _distinct(found)

    def _within(self, sight: Sight, window: Window) -> list[Hypothesis]:
        """Return the expected place and those found in a window, the most plausible first."""
        limits, local, surface = self._limits, sight.local, sight.new.surface
        points = thinned(surface.points, limits.points)
        starts: list[SE2] = []
        least = 0.0
        for _ in range(limits.most):
            found = search(local.field, points, window, least, *starts)
            if found is None:
                break
            if not starts:
                least = max(found.score - limits.behind, 0.0)
            starts.append(found.pose)
        matches = [refine(local.bins, surface, each, each, LOOSE) for each in starts]
        matches += [
            refined(local, surface, guess, guess, sight.predicted, self._tracking)
            for guess in (window.centre, sight.prior)
        ]
        result = [self.judged(sight, each) for each in matches]
        expected = result[-1]
        result.sort(key=lambda each: -each.worth)
        best = result[0]
        is_open = is_corridor(best.match, CORRIDOR)
        if is_open and expected.evidence > best.evidence - limits.same_evidence:
            # More overlap is no sign of less motion.
            result.remove(expected)
            result.insert(0, replace(expected, worth=best.worth))
        return result

    def expected(self, sight: Sight, predicted: PredictedMotion, match: Match | None) -> Hypothesis:
        """Return a match where odometry puts a scan; None: refined from there, held by it."""
        if match is None:
            surface, prior = sight.new.surface, sight.prior
            match = refined(sight.local, surface, prior, prior, predicted, self._tracking)
        return self.judged(sight, match)

    def judged(self, sight: Sight, match: Match) -> Hypothesis:
        """Return a match with its plausibility."""
        limits, new, predicted = self._limits, sight.new, sight.predicted
        walls, here = sight.walls, Window(match.pose, 0.0, 0.0)
        at = search(sight.local.field, walls.points, here, -1.0)
        score = 0.0 if at is None else at.score
        fits = (score, share_on_map(sight.local.bins, walls, match.pose))
        there = [both_ways(old, new, pose.inverse() @ match.pose) for old, pose in sight.seen]
        shares = np.minimum([through for _, through in there], limits.most_through)
        through = limits.through * float(np.mean(shares))
        hidden = there[-1][0]
        off = np.array((sight.prior.inverse() @ match.pose).log())
        sigmas = np.array([predicted.sigma_m, predicted.sigma_m, predicted.sigma_rad])
        habit = min(float(np.sum((off / sigmas) ** 2)), limits.most_unexpected)
        worth = (
            float(np.mean(fits))
            - through
            - limits.unexpected * habit
            - limits.far * float(np.sum((off / _SURPRISE) ** 2))
        )
        evidence = float(np.mean([min(each + hidden, 1.0) for each in fits])) - through
        return Hypothesis(match, score, worth, evidence)


def both_ways(old: Keyframe, new: Keyframe, pose: SE2) -> tuple[float, float]:
    """Return the share of new echoes of which an old scan says nothing, 0 to 1.

    And the share of echoes that beams of the other scan went through, both ways, 0 to 2.
    """
    there, back = each_of_other(old, new, pose)
    hidden = 1.0 - there.agrees - there.contradicts
    return hidden, there.contradicts + back.contradicts


def is_elsewhere(one: SE2, other: SE2) -> bool:
    """Return whether two poses are of different places."""
    off = one.inverse() @ other
    return math.hypot(off.x_m, off.y_m) > _SAME_M or abs(off.theta_rad) > _SAME_RAD


def _distinct(ranked: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Return hypotheses without those that lie where a better one does."""
    result: list[Hypothesis] = []
    for each in ranked:
        if all(is_elsewhere(other.match.pose, each.match.pose) for other in result):
            result.append(each)
    return result
