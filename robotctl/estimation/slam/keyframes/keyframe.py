"""Keyframes: scans that are kept, and how two of them are matched."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np

from robotctl.estimation.slam.front_end.agreement import (
    Agreement,
    ScanView,
    agreement,
    view_of,
)
from robotctl.estimation.slam.front_end.point_to_line import Bins, Match, binned, refine
from robotctl.estimation.slam.front_end.surface import Floats, Surface, surface_of
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan

LOOSE = np.diag(1.0 / np.array([0.3, 0.3, 0.1]) ** 2)
"""Prior that holds a match along corridors near its start; without weight elsewhere."""
_AT_HAND: Final = 128
_BINS_AT_HAND: Final = 32
"""Scans whose echoes are kept, in bins or not, which take ten to a hundred times the memory of a
scan; those of others are found again when they are needed."""
_SHARE: Final = 0.25
CORRIDOR: Final = 0.15
"""Ratio of the information along to that across, below which a stretch is a corridor."""
_LEAST: Final = np.array([1.0, 1.0, 25.0])
_BENT: Final = np.array([0.03, 0.03, 0.01]) ** 2
"""Variances by which odometry bends a stretch [m^2, m^2, rad^2]: measured, not tuned."""


@lru_cache(maxsize=_AT_HAND)
def surface_at_hand(scan: RangeScan) -> Surface:
    """Return the echoes of a scan, found once as long as it is among the last ones asked for."""
    return surface_of(scan)


@lru_cache(maxsize=_AT_HAND)
def _view(scan: RangeScan) -> ScanView:
    return view_of(scan)


@lru_cache(maxsize=_BINS_AT_HAND)
def _bins(scan: RangeScan) -> Bins:
    return binned(surface_at_hand(scan))


@dataclass(frozen=True, slots=True, eq=False)
class Keyframe:
    """A scan that is kept, with at least one echo.

    Parameters
    ----------
    scan
        The scan.
    travelled_m
        Distance travelled so far [m].
    """

    scan: RangeScan
    travelled_m: float

    @property
    def stamp_ns(self) -> int:
        """Time of the scan [ns]."""
        return self.scan.stamp_ns

    @property
    def surface(self) -> Surface:
        """Echoes in its `base`."""
        return surface_at_hand(self.scan)

    @property
    def bins(self) -> Bins:
        """Echoes sorted for refinement, in its `base`."""
        return _bins(self.scan)

    @property
    def view(self) -> ScanView:
        """Ranges by direction, in its `base`."""
        return _view(self.scan)

    def sees(self, other: Keyframe, pose: SE2) -> float:
        """Return the share of another one's echoes, at a pose in this one, that it sees, too."""
        return agreement(self.view, other.surface, pose).agrees


def each_of_other(old: Keyframe, new: Keyframe, pose: SE2) -> tuple[Agreement, Agreement]:
    """Return what an old scan says of a new one at a pose in it, and the new one of the old."""
    return (
        agreement(old.view, new.surface, pose),
        agreement(new.view, old.surface, pose.inverse()),
    )


def compared(old: Keyframe, new: Keyframe, pose: SE2) -> tuple[float, float]:
    """Return the minimum overlap and the maximum contradiction of two scans, 0 to 1.

    Overlap is a share of all echoes, contradiction one of those that the other scan could see.
    """
    there, back = each_of_other(old, new, pose)
    return min(there.agrees, back.agrees), max(1.0 - there.of_seen, 1.0 - back.of_seen)


def match_pair(
    first: Keyframe, second: Keyframe, start: SE2, config: KeyframeConfig, wide_m: float
) -> Match | None:
    """Match the second of two keyframes with the first, near a start.

    None if they do not overlap, do not match, or contradict each other.
    """
    if first.sees(second, start) < config.tuning.links.hopeless_overlap:
        return None
    match = refine(first.bins, second.surface, start, start, LOOSE, wide_m)
    if config.stretch_m:
        match = replace(match, pose=held(match, start, CORRIDOR))
    if match.inliers < config.least_inliers:
        return None
    overlap, contradicts = compared(first, second, match.pose)
    is_same = (
        contradicts <= 1.0 - config.least_agreement and overlap >= config.tuning.links.least_overlap
    )
    if not is_same:
        return None
    return replace(match, information=honest(match.information)) if config.stretch_m else match


def honest(information: Floats) -> Floats:
    """Return the information (3, 3) of a match of scans gathered along the odometry.

    Echoes of one stretch share its errors; where most lie along a corridor, the few others say
    little about the position along it.
    """
    H = without_corridor(_SHARE * information)
    result: Floats = np.linalg.inv(np.linalg.inv(H + np.diag(_LEAST)) + np.diag(_BENT))
    return result


def held(match: Match, start: SE2, share: float) -> SE2:
    """Return the pose of a match; in a corridor, with the position along it from the start.

    A corridor has less than `share` of the information across it along it.
    """
    along = _corridor(match.information, share)
    if along is None:
        return match.pose
    off = match.pose.inverse() @ start
    x, y = (along @ np.array([off.x_m, off.y_m]) * along).tolist()
    return match.pose @ SE2(x, y)


def is_corridor(match: Match, share: float) -> bool:
    """Return whether a match has less than `share` of the information across along something."""
    return _corridor(match.information, share) is not None


def without_corridor(information: Floats) -> Floats:
    """Return an information matrix (3, 3) without the part along a corridor, if there is one."""
    along = _corridor(information, CORRIDOR)
    if along is None:
        return information
    across = np.eye(3)
    across[:2, :2] -= np.outer(along, along)
    result: Floats = across @ information @ across
    return result


def _corridor(information: Floats, share: float) -> Floats | None:
    """Return the direction (2,) in which an information matrix (3, 3) is nearly zero, if any."""
    H = information
    by_place = H[:2, :2] - np.outer(H[:2, 2], H[:2, 2]) / max(H[2, 2], 1e-9)
    seen, directions = np.linalg.eigh(by_place)
    if seen[0] >= share * seen[1]:
        return None
    result: Floats = directions[:, 0]
    return result
