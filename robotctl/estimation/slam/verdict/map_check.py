"""Whether scans bear the map out: along the way, and where places were passed more than once.

Where a map is doubled or bent, a scan fits the walls of an earlier visit better at a distance from
where the map has it. People and moved furniture do not look like that: they fit nowhere. Where no
scan agrees with one before it, the map is two maps that lie side by side by chance.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from robotctl.estimation.slam.front_end.correlative import Window, search
from robotctl.estimation.slam.front_end.score_field import score_field
from robotctl.estimation.slam.keyframes.growing_map import GrowingMap
from robotctl.estimation.slam.keyframes.keyframe import compared
from robotctl.estimation.slam.keyframes.local_map import thinned
from robotctl.estimation.slam.robust.robust_cost import OFF

_APART: Final = 20
"""Difference in number from which keyframes are of different visits."""
_AROUND: Final = 6
_AROUND_M: Final = 5.0
"""Keyframes on each side of an earlier one, and their distance, that make up the place."""
_REVISIT_M: Final = 3.0
"""Distance of keyframes that see the same place [m]."""
_BESIDE_M: Final = 1.0
_ALIKE_RAD: Final = 0.5
"""Distance [m] and difference in heading [rad] of keyframes that see nearly the same."""
_HERE: Final = (0.1, 0.03)
"""Shift [m] and turn [rad] that still count as where the map has it."""
_NEARBY: Final = (1.5, 0.3)
"""The same for where it may fit better."""
_FITS: Final = 0.5
_BETTER: Final = 0.15
"""Score of a good fit, and its lead over that of the map's own place."""
_MOST: Final = 120
"""Number of keyframes that are compared."""
_ACROSS: Final = 4
"""Greatest difference in number of keyframes that may bear each other out across a break."""
_OVERLAP: Final = 0.15
_CONTRADICTION: Final = 0.3
"""Overlap and contradiction of two that do, as `keyframe.compared` has them."""


def shift_of(growing: GrowingMap, number: int) -> float | None:
    """Return how far off a keyframe fits the nearest earlier visit better [m]; None: there is none.

    0 where the map has it right, or nothing fits better.
    """
    config, keyframes, back_end = growing
    poses = back_end.poses
    earlier = poses[: max(number - _APART, 0), :2]
    if not len(earlier):
        return None
    away_m = np.hypot(*(earlier - poses[number, :2]).T)
    other = int(np.argmin(away_m))
    if away_m[other] > _REVISIT_M:
        return None
    place = [
        each
        for each in range(max(other - _AROUND, 0), min(other + _AROUND + 1, number - _APART // 2))
        if np.hypot(*(poses[each, :2] - poses[other, :2])) < _AROUND_M
    ]
    walls = score_field(growing.surface(place, other).outline)
    points = thinned(keyframes[number].surface.points, config.tuning.tracking.search_points)
    at = back_end.between(other, number)
    here = search(walls, points, Window(at, *_HERE), -1.0)
    least = max(_FITS, _BETTER + (0.0 if here is None else here.score))
    nearby = search(walls, points, Window(at, *_NEARBY), least)
    if nearby is None:
        return 0.0
    return math.hypot(nearby.pose.x_m - at.x_m, nearby.pose.y_m - at.y_m)


def shifts_of(growing: GrowingMap) -> list[float]:
    """Return how far off keyframes fit earlier visits better [m], of some evenly chosen."""
    last = len(growing.keyframes) - 1
    numbers = {int(each) for each in np.linspace(_APART, last, _MOST)} if last >= _APART else set()
    shifts = (shift_of(growing, each) for each in sorted(numbers))
    return [each for each in shifts if each is not None]


def contradicted_places(growing: GrowingMap) -> tuple[int, int]:
    """Return how many places contradict an earlier visit, and how many were compared.

    A keyframe is compared with the nearest that looks the same way from within a metre. A map put
    together wrongly has free space of one visit behind walls of the other.
    """
    _, keyframes, back_end = growing
    poses, contradicted, count = back_end.poses, 0, 0
    for number in np.unique(np.linspace(0, len(poses) - 1, _MOST).astype(np.int64)).tolist():
        earlier = poses[: max(number - _APART, 0)]
        away_m = np.hypot(*(earlier[:, :2] - poses[number, :2]).T)
        turn_rad = np.abs(np.angle(np.exp(1j * (earlier[:, 2] - poses[number, 2]))))
        beside = np.flatnonzero((away_m < _BESIDE_M) & (turn_rad < _ALIKE_RAD))
        if len(beside):
            other = int(beside[np.argmin((away_m + turn_rad)[beside])])
            at = back_end.between(other, number)
            count += 1
            contradicted += compared(keyframes[other], keyframes[number], at)[1] > _CONTRADICTION
    return contradicted, count


def breaks(growing: GrowingMap) -> list[int]:
    """Return the keyframes before which the map is broken: nothing but a guess leads to them.

    Neither do scans agree across the break, nor does a closed loop span it.
    """
    spanned = np.zeros(len(growing.keyframes) + 1, np.int64)
    links, weights = growing.back_end.links, np.array(growing.back_end.weights)
    ends = np.sort(links.ends[links.is_loop & (weights > OFF)], axis=1)
    np.add.at(spanned, ends[:, 0] + 1, 1)
    np.subtract.at(spanned, np.minimum(ends[:, 1] + 1, len(growing.keyframes)), 1)
    is_spanned = np.cumsum(spanned) > 0
    return [
        each
        for each in range(1, len(growing.keyframes))
        if not is_spanned[each] and not _agree_across(growing, each)
    ]


def _agree_across(growing: GrowingMap, number: int) -> bool:
    """Return whether a scan before a keyframe agrees with it, or with one soon after it."""
    for gap in range(1, _ACROSS + 1):
        for first in range(max(number - gap, 0), number):
            second = first + gap
            if second < len(growing.keyframes):
                overlap, contradicts = compared(
                    growing.keyframes[first],
                    growing.keyframes[second],
                    growing.back_end.between(first, second),
                )
                if overlap >= _OVERLAP and contradicts <= _CONTRADICTION:
                    return True
    return False
