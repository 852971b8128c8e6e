"""Scans that are kept, and links between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robotctl.estimation.slam.front_end.agreement import View, agreement, view_of
from robotctl.estimation.slam.front_end.point_to_line import Bins, Match, binned, refine
from robotctl.estimation.slam.front_end.surface import Floats, Surface, surface_of
from robotctl.estimation.slam.lidar.config import LidarSlamConfig
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan

LOOSE = np.diag(1.0 / np.array([0.3, 0.3, 0.1]) ** 2)
"""Holds a match along corridors near its start; of no weight elsewhere."""


@dataclass(frozen=True, slots=True, eq=False)
class Keyframe:
    """A scan that is kept.

    Parameters
    ----------
    stamp_ns
        Time of the scan [ns].
    scan
        The scan.
    surface, bins, view
        Its echoes, those sorted, and its ranges by direction; all in its `base`.
    travelled_m
        Length of the way so far [m].
    """

    stamp_ns: int
    scan: RangeScan
    surface: Surface
    bins: Bins
    view: View
    travelled_m: float


def keyframe_of(scan: RangeScan, surface: Surface, travelled_m: float) -> Keyframe:
    """Return the keyframe of a scan with at least one echo."""
    return Keyframe(scan.stamp_ns, scan, surface, binned(surface), view_of(scan), travelled_m)


@dataclass(frozen=True, slots=True, eq=False)
class PairMatch:
    """How two keyframes match: the pose of the second in the first, and why not, if so."""

    match: Match
    agreement: float
    seen: float
    reason: str


def match_pair(
    first: Keyframe, second: Keyframe, start: SE2, config: LidarSlamConfig, wide_m: float
) -> PairMatch:
    """Match the second of two keyframes with the first, near a start."""
    match = refine(first.bins, second.surface, start, start, LOOSE, wide_m)
    there = agreement(first.view, second.surface.points, second.surface.weights, match.pose)
    back = agreement(
        second.view, first.surface.points, first.surface.weights, match.pose.inverse()
    )
    agrees, seen = min(there.of_seen, back.of_seen), min(there.agrees, back.agrees)
    reason = ""
    if match.inliers < config.least_inliers:
        reason = f"{match.inliers:.0%} of the echoes match"
    elif agrees < config.least_agreement:
        reason = f"{1.0 - agrees:.0%} of the echoes contradict"
    elif seen < 0.25:
        reason = f"{seen:.0%} of the echoes overlap"
    return PairMatch(match, agrees, seen, reason)
