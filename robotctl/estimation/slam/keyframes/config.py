"""Settings of SLAM by scans."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class WheelNoise:
    """Noise of odometry; by default of wheels that slip by a tenth of the motion and more.

    Parameters
    ----------
    position
        Standard deviation of a motion's length: at least [m], for each metre, for each radian [m].
    heading
        Of its turn: at least [rad], for each metre [rad], for each radian.
    """

    position: tuple[float, float, float] = (0.02, 0.15, 0.05)
    heading: tuple[float, float, float] = (0.02, 0.05, 0.15)

    def sigma_m(self, distance_m: float, turn_rad: float) -> float:
        """Return the standard deviation of a motion's length [m]."""
        least, by_distance, by_turn = self.position
        return least + by_distance * distance_m + by_turn * turn_rad

    def sigma_rad(self, distance_m: float, turn_rad: float) -> float:
        """Return the standard deviation of a motion's turn [rad]."""
        least, by_distance, by_turn = self.heading
        return least + by_distance * distance_m + by_turn * turn_rad


@dataclass(frozen=True, slots=True)
class KeyframeConfig:
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
        changed. Scans taken at once that fit nowhere get none, and a lost robot is looked for.
    is_fixed
        Leave the map alone: the robot is only localised in it; with `is_live`.
    stretch_m
        Way that a scan is made of [m]; 0: it is taken at once. Such scans lie along the odometry
        until the robot comes back: two that share a stretch say nothing of each other.
    wheels
        What odometry is worth.
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
    stretch_m: float = 0.0
    wheels: WheelNoise = field(default_factory=WheelNoise)

    @property
    def shared(self) -> float:
        """How many keyframes each echo is in; more than one where stretches overlap."""
        return max(self.stretch_m / self.keyframe_m, 1.0) if self.stretch_m else 1.0
