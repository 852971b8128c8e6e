"""Matching each scan with a local map of the last keyframes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from robotctl.estimation.slam.front_end.correlative import Window, search
from robotctl.estimation.slam.front_end.point_to_line import (
    NARROW_M,
    Bins,
    Match,
    binned,
    refine,
)
from robotctl.estimation.slam.front_end.score_field import ScoreField, score_field
from robotctl.estimation.slam.front_end.surface import Floats, Surface, joined
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.keyframes.keyframe import Keyframe, held
from robotctl.estimation.slam.keyframes.motion import Expected
from robotctl.model.geometry.se2 import SE2

SEARCH_POINTS: Final = 180
_WIDE_M: Final = 1.0
_WIDE_POINTS: Final = 60
"""In a window of a metre and more to each side; there the time goes, and any place is a start for
the refinement by all points."""
_SURE: Final = 0.6
"""A match with a lower score is compared with those of a wider search."""
_BETTER: Final = 0.2
"""Lead in score that a match farther from the prior needs to replace a nearer one."""
_WIDER: Final = 2.5
_LOST_M: Final = 0.5
_LOST_RAD: Final = 0.5
"""Doubt of the prior in the wider search at least: wheels slip, clocks jump."""
_FARTHEST_M: Final = 2.5
_CORRIDOR: Final = 0.01
"""Information along, beside that across, where walls say nothing of the place along them."""
_STILL_MATCHES: Final = 0.75
CONTRADICTS: Final = 16.27
"""chi2 of 3 numbers that one in a thousand exceeds."""


@dataclass(frozen=True, slots=True, eq=False)
class LocalMap:
    """Surfaces in the frame of the newest keyframe."""

    bins: Bins
    field: ScoreField


def local_map(keyframes: list[Keyframe], poses: list[SE2]) -> LocalMap:
    """Return the map of keyframes at poses in one frame."""
    surface = joined(
        [each.surface.moved(pose) for each, pose in zip(keyframes, poses, strict=True)]
    )
    return LocalMap(binned(surface), score_field(surface.outline))


def thinned(points: Floats, most: int) -> Floats:
    """Return at most so many of points (n, 2), evenly."""
    if len(points) <= most:
        return points
    return points[np.linspace(0, len(points) - 1, most).astype(np.int64)]


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """A scan's place on the local map.

    Parameters
    ----------
    pose
        Of `base` in the frame of the local map.
    match
        None if the scan does not fit anywhere near: the pose is the expected one then.
    score
        Of the search.
    has_slipped
        Whether odometry contradicts the match.
    """

    pose: SE2
    match: Match | None
    score: float
    has_slipped: bool


def track(
    local: LocalMap, surface: Surface, last: SE2, expected: Expected, config: KeyframeConfig
) -> Tracked:
    """Return where a scan was taken, after a motion from a last pose on a local map."""
    prior = last @ expected.motion
    score, match = _attempt(local, surface, prior, expected)
    if score < _SURE or match.inliers < config.least_inliers:
        lost = Expected(
            expected.motion,
            max(_WIDER * expected.sigma_m, _LOST_M),
            max(_WIDER * expected.sigma_rad, _LOST_RAD),
        )
        wide_score, wide = _attempt(local, surface, prior, lost)
        fits = score >= config.least_score and match.inliers >= config.least_inliers
        if not fits or wide_score > score + _BETTER:
            score, match = wide_score, wide
    if score < config.least_score or match.inliers < config.least_inliers:
        return Tracked(prior, None, 0.0, has_slipped=False)
    return Tracked(match.pose, match, score, _contradicts(prior, expected, match))


def is_new(tracked: Tracked, config: KeyframeConfig) -> bool:
    """Return whether a scan, placed in the frame of the last keyframe, becomes a keyframe."""
    pose, match = tracked.pose, tracked.match
    if config.is_live and match is None and not config.stretch_m:
        return False
    return (
        float(np.hypot(pose.x_m, pose.y_m)) >= config.keyframe_m
        or abs(pose.theta_rad) >= config.keyframe_rad
        or (match is not None and match.inliers < config.keyframe_overlap)
    )


def _attempt(
    local: LocalMap, surface: Surface, prior: SE2, expected: Expected
) -> tuple[float, Match]:
    """Return score and refined match of the best pose around a prior."""
    window = Window(
        prior,
        min(3.0 * expected.sigma_m, _FARTHEST_M),
        min(3.0 * expected.sigma_rad, np.pi),
        expected.sigma_m,
        expected.sigma_rad,
    )
    most = SEARCH_POINTS if window.shift_m < _WIDE_M else _WIDE_POINTS
    found = search(local.field, thinned(surface.points, most), window, -1.0)
    start, score = (prior, 0.0) if found is None else (found.pose, found.score)
    match = refine(local.bins, surface, start, prior, expected.information)
    return score, _held(local, surface, match, prior, expected)


def _held(local: LocalMap, surface: Surface, match: Match, prior: SE2, expected: Expected) -> Match:
    """Return a match which the prior holds along a corridor, if it is in one.

    There the search prefers to stand still, where all of a scan overlaps with the map. Zhang,
    Kaess, Singh: On degeneracy of optimization-based state estimation problems, ICRA 2016.
    """
    start = held(match, prior, _CORRIDOR)
    if start is match.pose:
        return match
    along = refine(local.bins, surface, start, prior, expected.information, NARROW_M)
    return along if along.inliers > _STILL_MATCHES * match.inliers else match


def _contradicts(prior: SE2, expected: Expected, match: Match) -> bool:
    """Return whether the match is too far from what was expected."""
    r = np.array((prior.inverse() @ match.pose).log())
    S = expected.covariance + np.linalg.inv(match.information + 1e-3 * np.eye(3))
    return float(r @ np.linalg.solve(S, r)) > CONTRADICTS
