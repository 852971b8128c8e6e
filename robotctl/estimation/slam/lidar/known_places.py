"""Places that are on the map already: they get no keyframe more, and a new scan where they changed.

So a robot that stays in one building keeps a map of one size, which shows what was seen last.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from robotctl.estimation.slam.front_end.surface import surface_of
from robotctl.estimation.slam.lidar.back_end import BackEnd
from robotctl.estimation.slam.lidar.config import LidarSlamConfig
from robotctl.estimation.slam.lidar.keyframe import Keyframe, compared, keyframe_of, match_pair
from robotctl.model.geometry.se2 import SE2

NEAR_M: Final = 0.4
"""Keyframes are this far apart, unless they see different things."""
LOOSE_M: Final = 0.25
LOOSE_RAD: Final = 0.08
"""With less doubt between, old keyframes are where they are; others are loops to close."""
_TRIES: Final = 3
_CHANGED: Final = 0.04
"""Of what two scans say of each other: with more contradicting, something was moved."""
_YOUNG_M: Final = 5.0
"""Way after which a scan may be replaced: people walk about."""
_WIDE_M: Final = 0.15


@dataclass(frozen=True, slots=True)
class Known:
    """The keyframe of a known place.

    Parameters
    ----------
    number
        Of the keyframe.
    pose
        Of `base` in it.
    is_changed
        Whether the place looks otherwise now.
    """

    number: int
    pose: SE2
    is_changed: bool


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
    config: LidarSlamConfig,
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
            return Known(other, there, contradicts > _CHANGED and not is_young)
        if contradicts > 1.0 - config.least_agreement and not is_young:
            return Known(other, there, is_changed=True)
    return None


def nearest(reference: int, pose: SE2, back_end: BackEnd) -> Known:
    """Return the keyframe nearest to a pose in another one, whatever it sees."""
    at = back_end.pose(reference) @ pose
    away = np.hypot(*(back_end.poses[:, :2] - (at.x_m, at.y_m)).T)
    sure = certain(back_end.doubts(reference))
    number = int(np.argmin(np.where(sure, away, np.inf)))
    return Known(number, back_end.between(number, reference) @ pose, is_changed=False)


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
