"""Matching each scan with a local map of the last keyframes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robotctl.estimation.slam.front_end.correlative import Window, search
from robotctl.estimation.slam.front_end.point_to_line import Bins, Match, binned, refine
from robotctl.estimation.slam.front_end.score_field import ScoreField, score_field
from robotctl.estimation.slam.front_end.surface import Floats, Surface, joined
from robotctl.estimation.slam.lidar.config import LidarSlamConfig
from robotctl.estimation.slam.lidar.keyframe import Keyframe
from robotctl.estimation.slam.lidar.motion import Expected
from robotctl.model.geometry.se2 import SE2

SEARCH_POINTS = 180
_WIDER = 2.5
_SLIP = 16.27
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
    local: LocalMap, surface: Surface, last: SE2, expected: Expected, config: LidarSlamConfig
) -> Tracked:
    """Return where a scan was taken, after a motion from a last pose on a local map."""
    prior = last @ expected.motion
    points = thinned(surface.points, SEARCH_POINTS)
    for wider in (1.0, _WIDER):
        sigma_m, sigma_rad = wider * expected.sigma_m, wider * expected.sigma_rad
        window = Window(
            prior, min(3.0 * sigma_m, 2.5), min(3.0 * sigma_rad, np.pi), sigma_m, sigma_rad
        )
        found = search(local.field, points, window, -1.0)
        if found is None:
            break
        information = expected.information / wider**2
        match = refine(local.bins, surface, found.pose, prior, information)
        if found.score >= config.least_score and match.inliers >= config.least_inliers:
            return Tracked(match.pose, match, found.score, _contradicts(prior, expected, match))
    return Tracked(prior, None, 0.0, False)


def _contradicts(prior: SE2, expected: Expected, match: Match) -> bool:
    """Return whether the match is too far from what was expected."""
    r = np.array((prior.inverse() @ match.pose).log())
    S = np.linalg.inv(expected.information) + np.linalg.inv(match.information + 1e-3 * np.eye(3))
    return float(r @ np.linalg.solve(S, r)) > _SLIP
