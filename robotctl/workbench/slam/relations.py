"""Relations of two keyframes that a person gives: roughly, for scans to refine, or exactly."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.errors import RobotctlError
from robotctl.estimation.slam.front_end.correlative import Window
from robotctl.estimation.slam.front_end.surface import Surface
from robotctl.estimation.slam.keyframes.back_end import KeyframeLink
from robotctl.estimation.slam.keyframes.growing_map import GrowingMap
from robotctl.estimation.slam.keyframes.keyframe import compared
from robotctl.estimation.slam.keyframes.local_map import Fit, LocalMap, map_of, thinned
from robotctl.estimation.slam.keyframes.verification import matching_pairs
from robotctl.model.geometry.se2 import SE2
from robotctl.workbench.slam.edits import Loop

_GIVEN_RAD: Final = math.radians(30.0)
"""Error of a heading that is given roughly."""
_WORTH_TELLING: Final = 0.2
"""Score below which a search need not say how badly a scan fits."""
_EDGE_M: Final = 0.11
"""Distance from the edge of a window within which the best place may lie beyond: two cells."""
_EXACT: Final = np.diag(1.0 / np.array([0.02, 0.02, math.radians(0.5)]) ** 2)


class RelationError(RobotctlError):
    """Scans contradict a relation, or do not tell it."""


@dataclass(frozen=True, slots=True, eq=False)
class Relation:
    """A relation that counts.

    Parameters
    ----------
    links
        Its links.
    pose
        Pose of the other keyframe in the first.
    score
        Of the search, 0 to 1; NaN: the pose was exact.
    overlap, contradiction
        Of the two scans there, as `keyframe.compared` has them.
    """

    links: list[KeyframeLink]
    pose: SE2
    score: float
    overlap: float
    contradiction: float


def related(
    growing: GrowingMap, drives: NDArray[np.int64], edit: Loop, first: int, other: int
) -> Relation:
    """Return the relation of two keyframes, with links that keep their weight.

    Parameters
    ----------
    growing
        The map.
    drives
        Number of the drive of each keyframe, (n,).
    edit, first, other
        The relation as given, and the keyframes' numbers in the map.

    Raises
    ------
    RelationError
        If the scans fit nowhere in the window, at two places, or contradict an exact pose.
    """
    if edit.exact:
        return _exact(growing, edit, first, other)
    limits = growing.config.tuning.verification
    place = _around(growing, drives, first, other, limits.around, limits.around_m)
    seen = _around(growing, drives, other, first, limits.recent, limits.recent_m)
    target = map_of(growing.surface(place, first))
    fit = _searched(growing, edit, target, growing.surface(seen, other))
    links = matching_pairs(growing, place, first, other, fit.match.pose)
    if not links:
        raise RelationError(
            f"the scans fit best at {_told(fit.match.pose)}, but no two of them match there one "
            f"by one: {_compared(growing, first, other, fit.match.pose)}; name keyframes that see "
            "more of the same, or give the pose with exact = true"
        )
    overlap, contradiction = max(
        compared(growing.keyframes[each.first], growing.keyframes[other], each.pose)
        for each in links
    )
    given = [replace(each, is_given=True) for each in links]
    return Relation(given, fit.match.pose, fit.score, overlap, contradiction)


def _exact(growing: GrowingMap, edit: Loop, first: int, other: int) -> Relation:
    """Return a relation as it is given, unless its scans contradict it."""
    config, keyframes, _ = growing
    overlap, contradiction = compared(keyframes[first], keyframes[other], edit.pose)
    least, most = config.tuning.links.least_overlap, 1.0 - config.least_agreement
    if not edit.unchecked and (overlap < least or contradiction > most):
        raise RelationError(
            f"{_compared(growing, first, other, edit.pose)}; an overlap of {least:.0%} or more and "
            f"a contradiction of {most:.0%} or less allowed; leave exact out to have the place "
            "found by the scans, or add unchecked = true if the pose is right all the same"
        )
    link = KeyframeLink(first, other, edit.pose, _EXACT, is_loop=True, is_given=True)
    return Relation([link], edit.pose, math.nan, overlap, contradiction)


def _searched(growing: GrowingMap, edit: Loop, target: LocalMap, surface: Surface) -> Fit:
    """Return where a surface fits a map best, within the window of a relation."""
    limits = growing.config.tuning.verification
    is_gathered = growing.config.stretch_m > 0.0
    turn_rad = math.pi if edit.heading_deg is None else _GIVEN_RAD
    window = Window(edit.pose, edit.within_m, turn_rad)
    points = thinned(surface.points, limits.points)
    fit = target.fit(surface, points, window, _WORTH_TELLING)
    least = limits.least_score_stretches if is_gathered else limits.least_score
    if fit is None or fit.score < least or fit.match.inliers < limits.least_inliers:
        found = f"no place has a score of {_WORTH_TELLING:.0%}"
        if fit is not None:
            found = (
                f"the best of all, {_told(fit.pose)}, has a score of {fit.score:.0%} and "
                f"{fit.match.inliers:.0%} of the echoes match"
            )
        raise RelationError(
            f"the scans do not fit within {edit.within_m:g} m: {found}; a score of {least:.0%} and "
            f"{limits.least_inliers:.0%} of the echoes needed; name keyframes that see more of the "
            "same, or give the pose with exact = true"
        )
    aside_m = max(abs(fit.pose.x_m - edit.x_m), abs(fit.pose.y_m - edit.y_m))
    if aside_m > edit.within_m - _EDGE_M:
        raise RelationError(
            f"the scans fit best at the edge of the {edit.within_m:g} m in which they were "
            f"compared, {_told(fit.pose)}, and may fit better beyond: give x_m and y_m more "
            "closely, or a larger within_m"
        )
    # A full turn is taken from the opposite heading on, or the same place were found at its end.
    centre = (
        edit.pose
        if edit.heading_deg is not None
        else SE2(edit.pose.x_m, edit.pose.y_m, fit.pose.theta_rad)
    )
    window = Window(centre, edit.within_m, turn_rad)
    rival = target.rival(points, window, limits.ambiguous, fit)
    if rival is not None:
        raise RelationError(
            f"the scans fit at two places nearly as well: {_told(fit.pose)} (score "
            f"{fit.score:.0%}) and {_told(rival.pose)} ({rival.score:.0%}); give x_m, y_m and "
            "heading_deg of the right one, and a within_m that leaves the other out"
        )
    return fit


def _compared(growing: GrowingMap, first: int, other: int, pose: SE2) -> str:
    """Return how far two scans overlap and contradict each other, for people."""
    overlap, contradiction = compared(growing.keyframes[first], growing.keyframes[other], pose)
    if not overlap:
        return "the scans do not overlap"
    return f"the scans overlap by {overlap:.0%} and contradict each other by {contradiction:.0%}"


def _told(pose: SE2) -> str:
    """Return a pose as a file of edits has it."""
    return (
        f"x_m = {pose.x_m:.2f}, y_m = {pose.y_m:.2f}, "
        f"heading_deg = {math.degrees(pose.theta_rad):.0f}"
    )


def _around(
    growing: GrowingMap,
    drives: NDArray[np.int64],
    centre: int,
    away: int,
    reach: int,
    within_m: float,
) -> list[int]:
    """Return the keyframes around one, of its drive, all nearer to it than to another one."""
    poses = growing.back_end.poses
    numbers = np.arange(len(poses))
    own = np.abs(numbers - centre)
    is_around = (own <= reach) & (drives == drives[centre])
    if drives[away] == drives[centre]:
        is_around &= own < np.abs(numbers - away)
    is_around &= np.hypot(*(poses[:, :2] - poses[centre, :2]).T) < within_m
    found: list[int] = np.flatnonzero(is_around).tolist()
    return found
