"""Settings of a mapper: what its sensor needs, and the thresholds of the robot's file."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from robotctl.estimation.slam_tuning import SlamTuning
from robotctl.model.drives.odometry_noise import MotionNoise

_STANDS_M: Final = 1e-3
_STANDS_RAD: Final = 1e-3
"""Minimum standard deviations of a motion by calibrated wheels [m], [rad]."""


@dataclass(frozen=True, slots=True)
class WheelNoise:
    """Noise of wheels that slip by a share of the motion; by default by a tenth and more.

    Parameters
    ----------
    position
        Standard deviation of a motion's length: minimum [m], per metre, per radian [m].
    heading
        Standard deviation of its turn: minimum [rad], per metre [rad], per radian.
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
class CalibratedWheels:
    """Noise of odometry as the robot's file has it: white along the way, so variances add.

    The errors of two halves of a way are those of the whole, however it is cut; those of wheels
    that slip by a share of each motion would be forgotten the sooner, the shorter the pieces are.

    Parameters
    ----------
    noise
        Noises e, f and g of `motion_noise.py`.
    """

    noise: MotionNoise = field(default_factory=MotionNoise)

    def sigma_m(self, distance_m: float, turn_rad: float) -> float:
        """Return the standard deviation of a motion's end [m], along it or across.

        Across, a heading of variance q per metre is off by q d^3 / 3, the integral of its path.
        """
        along = self.noise.e_m_per_sqrt_m**2 * distance_m
        across = self._heading(distance_m, turn_rad) * distance_m**2 / 3.0
        return math.sqrt(max(along, across, _STANDS_M**2))

    def sigma_rad(self, distance_m: float, turn_rad: float) -> float:
        """Return the standard deviation of a motion's turn [rad]."""
        return math.sqrt(max(self._heading(distance_m, turn_rad), _STANDS_RAD**2))

    def _heading(self, distance_m: float, turn_rad: float) -> float:
        """Return the variance of the heading after a motion [rad^2]."""
        by_way = self.noise.f_rad_per_sqrt_m**2 * distance_m
        return by_way + self.noise.g_rad_per_sqrt_rad**2 * turn_rad


@dataclass(frozen=True, slots=True)
class KeyframeConfig:
    """Settings of a mapper; the defaults are for indoor robots with lidars of 100 beams or more.

    Parameters
    ----------
    keyframe_m, keyframe_rad
        Motion after which a scan becomes a keyframe [m], [rad].
    keyframe_overlap
        Share of a scan's echoes on the map of the last keyframes, below which it becomes one, too.
    local_keyframes
        Number of keyframes that a scan is matched with, the last ones.
    linked_keyframes
        Number of keyframes that a new one is linked with, one by one, the last ones.
    least_score
        Minimum score of the search, 0 to 1.
    least_inliers
        Minimum share of the echoes on the map.
    least_agreement
        Minimum share of the points seen by two scans on which they agree, 0 to 1.
    is_live
        Whether the map is a robot's for life: a known place gets no more keyframes, but a new scan
        where it changed. Scans taken at once that match nothing are left out, and a lost robot is
        relocalised.
    is_fixed
        Whether the map stays as it is and the robot is only localised in it; with `is_live`.
    stretch_m
        Distance along which a scan is gathered [m]; 0: it is taken at once. Gathered scans lie
        along the odometry until the robot returns: two that share a stretch say nothing of each
        other.
    wheels
        Noise of odometry.
    tuning
        Thresholds of the stages.
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
    wheels: WheelNoise | CalibratedWheels = field(default_factory=WheelNoise)
    tuning: SlamTuning = field(default_factory=SlamTuning)

    @property
    def shared(self) -> float:
        """Number of keyframes that contain each echo; more than one where stretches overlap."""
        return max(self.stretch_m / self.keyframe_m, 1.0) if self.stretch_m else 1.0
