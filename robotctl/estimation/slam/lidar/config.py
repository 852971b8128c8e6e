"""What SLAM by lidar takes for granted."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class LidarSlamConfig:
    """Settings; the defaults are for robots indoors with lidars of 100 beams or more.

    Parameters
    ----------
    keyframe_m, keyframe_rad
        A scan becomes a keyframe this far from the last one [m], [rad].
    keyframe_overlap
        Or where less than this share of its echoes lies on the map of the last ones.
    local_keyframes
        The last ones that a scan is matched with.
    linked_keyframes
        The last ones that a keyframe is linked with, one by one.
    least_score
        Of the search, 0 to 1, below which a match counts for nothing.
    least_inliers
        Share of the echoes on the map, below which a match counts for nothing.
    least_agreement
        Share of what two scans say of each other that must agree, 0 to 1.
    is_live
        A robot's map for life: a place that is on it gets no keyframe more, but a new scan where it
        changed; scans that fit nowhere get none, and a robot that is lost is looked for.
    is_fixed
        Leave the map alone: the robot is only localised in it; with `is_live`.
    """

    keyframe_m: float = 0.3
    keyframe_rad: float = 0.25
    keyframe_overlap: float = 0.6
    local_keyframes: int = 12
    linked_keyframes: int = 8
    least_score: float = 0.35
    least_inliers: float = 0.3
    least_agreement: float = 0.75
    is_live: bool = False
    is_fixed: bool = False
