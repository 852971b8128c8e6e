"""Places that are on the map already: they get no keyframe more, and a new scan where they changed.

So a robot that stays in one building keeps a map of one size, which shows what was seen last.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from robotctl.estimation.slam.front_end.surface import Floats, surface_of
from robotctl.estimation.slam.keyframes.back_end import BackEnd
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.keyframes.keyframe import Keyframe, compared, keyframe_of, match_pair
from robotctl.estimation.slam.keyframes.tracker import CONTRADICTS
from robotctl.model.geometry.se2 import SE2

NEAR_M: Final = 0.4
"""Keyframes are this far apart, unless they see different things."""
LOOSE_M: Final = 0.25
LOOSE_RAD: Final = 0.08
"""With less doubt between, old keyframes are where they are; others are loops to close."""
_TRIES: Final = 3
CHANGED: Final = 0.04
"""Share of two scans that may contradict: beyond it, something was moved."""
_YOUNG_M: Final = 5.0
"""Way after which a scan may be replaced: people walk about."""
_WIDE_M: Final = 0.15
_MOVED: Final = 0.05
"""Share of two scans that may contradict, of half of the keyframes asked about a place."""
_PASSES: Final = 6
"""Keyframes to pass until a place where the robot was found is sure: half of them bear it out."""


@dataclass(frozen=True, slots=True)
class Known:
    """The keyframe of a known place.

    Parameters
    ----------
    number
        Of the keyframe.
    pose
        Of `base` in it.
    contradicts
        Share of what the two scans say of each other.
    is_young
        Whether its scan was taken on the last metres.
    information
        Of the pose, (3, 3) in its own frame; None: no match tells it.
    """

    number: int
    pose: SE2
    contradicts: float
    is_young: bool
    information: Floats | None = None

    def weighed(self, start: SE2, covariance: Floats) -> tuple[Known, Floats] | None:
        """Return the place and its covariance, with the pose that a start and the match tell.

        None if the two contradict each other, or nothing was matched.

        Parameters
        ----------
        start, covariance
            `base` in the keyframe as odometry has it, (3, 3) in its own frame.
        """
        if self.information is None:
            return None
        off = np.array((self.pose.inverse() @ start).log())
        doubt = covariance + np.linalg.inv(self.information)
        if off @ np.linalg.solve(doubt, off) > CONTRADICTS:
            return None
        before = np.linalg.inv(covariance)
        after = np.linalg.inv(before + self.information).astype(np.float64)
        pose = self.pose @ SE2.exp(*(after @ before @ off).tolist())
        return replace(self, pose=pose), after


def certain(doubts: np.ndarray) -> np.ndarray:
    """Return of which keyframes the place is certain, by `BackEnd.doubts`, (n,)."""
    result: np.ndarray = (doubts[:, 0] < LOOSE_M) & (doubts[:, 1] < LOOSE_RAD)
    return result


def known_place(
    new: Keyframe,
    reference: int,
    pose: SE2,
    keyframes: list[Keyframe],
    back_end: BackEnd,
    config: KeyframeConfig,
) -> Known | None:
    """Return the keyframe that sees what a new one sees; None: there is none.

    Parameters
    ----------
    new, reference, pose
        A scan, and its pose in a keyframe.
    keyframes, back_end
        The map.
    config
        Of the mapper.
    """
    at = back_end.pose(reference) @ pose
    away = np.hypot(*(back_end.poses[:, :2] - (at.x_m, at.y_m)).T)
    near = np.flatnonzero((away < NEAR_M) & certain(back_end.doubts(reference)))
    turn = np.abs(np.angle(np.exp(1j * (back_end.poses[near, 2] - at.theta_rad))))
    for other in near[np.argsort(away[near] + 0.1 * turn)][:_TRIES].tolist():
        old = keyframes[other]
        start = back_end.pose(other).inverse() @ at
        if not _is_open(old, start):
            continue
        pair = match_pair(old, new, start, config, _WIDE_M)
        there = start if pair is None else pair.pose
        overlap, contradicts = compared(old, new, there)
        is_young = new.travelled_m - old.travelled_m < _YOUNG_M
        if pair is not None and overlap >= config.keyframe_overlap:
            information = pair.information / config.shared
            return Known(other, there, contradicts, is_young, information)
        is_other = contradicts > 1.0 - config.least_agreement and not config.stretch_m
        if is_other and not is_young:
            return Known(other, there, contradicts, is_young)
    return None


def nearest(reference: int, pose: SE2, back_end: BackEnd) -> Known:
    """Return the keyframe nearest to a pose in another one, whatever it sees."""
    at = back_end.pose(reference) @ pose
    away = np.hypot(*(back_end.poses[:, :2] - (at.x_m, at.y_m)).T)
    sure = certain(back_end.doubts(reference))
    number = int(np.argmin(np.where(sure, away, np.inf)))
    return Known(number, back_end.between(number, reference) @ pose, 0.0, is_young=True)


def renewed(new: Keyframe, pose: SE2) -> Keyframe:
    """Return a keyframe with the scan of another, taken at a pose in it."""
    scan = new.scan
    sensor = pose @ SE2(scan.x_m, scan.y_m)
    turned = replace(
        scan, angles_rad=scan.angles_rad + pose.theta_rad, x_m=sensor.x_m, y_m=sensor.y_m
    )
    return keyframe_of(turned, surface_of(turned), new.travelled_m)


def _is_open(old: Keyframe, pose: SE2) -> bool:
    """Return whether no wall that a keyframe saw stands between it and a pose."""
    x, y = pose.x_m - old.view.x_m, pose.y_m - old.view.y_m
    sectors = len(old.view.nearest)
    sector = int(np.floor(np.arctan2(y, x) * sectors / (2.0 * np.pi))) % sectors
    return bool(old.view.farthest[sector] == 0.0 or np.hypot(x, y) < old.view.nearest[sector])


def is_borne_out(new: Keyframe, at: SE2, asked: Sequence[Keyframe], poses: Floats) -> bool:
    """Return whether keyframes at poses (n, 3) bear out that a scan was taken at a pose.

    A robot that was carried away may be where much looks the same.
    """
    agreeing = 0
    for old, row in zip(asked, poses.tolist(), strict=True):
        agreeing += compared(old, new, SE2(*row).inverse() @ at)[1] < _MOVED
    return 2 * agreeing >= len(asked)


class Probation:
    """Judges the place where a robot was found by the keyframes that it passes.

    Until then the map is left alone: what is not on it may look like what is.
    """

    def __init__(self) -> None:
        self._passed = self._against = 0

    def ends_with(self, known: Known | None) -> bool:
        """Take a keyframe that was passed, None where none is; return whether all is clear."""
        self._passed += 1
        self._against += known is None or known.contradicts > CHANGED
        return self.is_refuted or self._passed >= _PASSES

    @property
    def is_refuted(self) -> bool:
        """Whether too many contradict it."""
        return 2 * self._against > _PASSES
