"""Registration of a scan on a local map: searched for around where it is expected, then refined."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robotctl.estimation.slam.front_end.correlative import Window, search
from robotctl.estimation.slam.front_end.point_to_line import NARROW_M, Match, refine
from robotctl.estimation.slam.front_end.surface import Surface
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.keyframes.keyframe import held
from robotctl.estimation.slam.keyframes.local_map import LocalMap, thinned
from robotctl.estimation.slam.keyframes.motion import CONTRADICTS, PredictedMotion
from robotctl.estimation.slam_tuning import TrackingConfig
from robotctl.model.geometry.se2 import SE2


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """A scan's place on the local map.

    Parameters
    ----------
    pose
        Pose of `base` in the frame of the local map.
    match
        None if the scan does not fit anywhere near: the pose is the predicted one then.
    score
        Score of the search, 0 to 1.
    has_slipped
        Whether odometry contradicts the match.
    """

    pose: SE2
    match: Match | None
    score: float
    has_slipped: bool


def track(
    local: LocalMap, surface: Surface, last: SE2, predicted: PredictedMotion, config: KeyframeConfig
) -> Tracked:
    """Return the pose of a scan on a local map, after a predicted motion from the last pose."""
    prior, limits = last @ predicted.motion, config.tuning.tracking
    score, match = _attempt(local, surface, prior, predicted, limits)
    if score < limits.sure_score or match.inliers < config.least_inliers:
        lost = PredictedMotion(
            predicted.motion,
            max(limits.wider * predicted.sigma_m, limits.wider_m),
            max(limits.wider * predicted.sigma_rad, limits.wider_rad),
        )
        wide_score, wide = _attempt(local, surface, prior, lost, limits)
        fits = score >= config.least_score and match.inliers >= config.least_inliers
        if not fits or wide_score > score + limits.better_score:
            score, match = wide_score, wide
    if score < config.least_score or match.inliers < config.least_inliers:
        return Tracked(prior, None, 0.0, has_slipped=False)
    return Tracked(match.pose, match, score, contradicts(prior, predicted, match))


def _attempt(
    local: LocalMap,
    surface: Surface,
    prior: SE2,
    predicted: PredictedMotion,
    limits: TrackingConfig,
) -> tuple[float, Match]:
    """Return score and refined match of the best pose around a prior."""
    window = Window(
        prior,
        min(3.0 * predicted.sigma_m, limits.farthest_m),
        min(3.0 * predicted.sigma_rad, np.pi),
        predicted.sigma_m,
        predicted.sigma_rad,
    )
    most = limits.search_points if window.shift_m < limits.wide_m else limits.wide_points
    found = search(local.field, thinned(surface.points, most), window, -1.0)
    start, score = (prior, 0.0) if found is None else (found.pose, found.score)
    return score, refined(local, surface, start, prior, predicted, limits)


def refined(
    local: LocalMap,
    surface: Surface,
    start: SE2,
    prior: SE2,
    predicted: PredictedMotion,
    limits: TrackingConfig,
) -> Match:
    """Return the match near a start; in a corridor, with the position along it from the prior.

    There the search would prefer no motion, where all of a scan overlaps with the map. Zhang,
    Kaess, Singh: On degeneracy of optimization-based state estimation problems, ICRA 2016.
    """
    match = refine(local.bins, surface, start, prior, predicted.information)
    start = held(match, prior, limits.corridor)
    if start is match.pose:
        return match
    along = refine(local.bins, surface, start, prior, predicted.information, NARROW_M)
    return along if along.inliers > limits.still_matches * match.inliers else match


def contradicts(prior: SE2, predicted: PredictedMotion, match: Match) -> bool:
    """Return whether the match contradicts the prediction."""
    r = np.array((prior.inverse() @ match.pose).log())
    S = predicted.covariance + np.linalg.inv(match.information + 1e-3 * np.eye(3))
    return float(r @ np.linalg.solve(S, r)) > CONTRADICTS
