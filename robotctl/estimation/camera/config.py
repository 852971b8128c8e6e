"""Settings of the ground-plane camera."""

from __future__ import annotations

import math
from dataclasses import dataclass

from robotctl.errors import InvalidValue


@dataclass(frozen=True, slots=True)
class GroundCameraConfig:
    """Settings to distinguish floor from objects, and their trust.

    Parameters
    ----------
    patch_near_m
        Distance of the free patch, from which the floor's look is learnt, from the nearest floor in
        the picture [m]. Anything nearer is not judged, which hides the robot's own bumper.
    patch_depth_m
        How far the free patch reaches from there [m].
    patch_near_width_m
        Width of the free patch at its near side [m].
    patch_far_width_m
        Width of the free patch at its far side [m].
    adaption
        Share of the floor model that one picture replaces, (0, 1].
    max_range_m
        Maximum range [m].
    beams
        Beams of the range scan, evenly over the picture's width.
    least_height_m
        Lower objects are ignored [m].
    least_width_m
        Narrower objects are ignored [m].
    boundary_sigma_px
        Standard deviation of a boundary in the picture [px].
    pitch_sigma_deg
        Standard deviation of the robot's pitch while it drives [deg].
    calibration_sigma_deg
        Standard deviation of the calibrated angles of the camera [deg].
    height_sigma
        Standard deviation of the camera's calibrated height, as a share of it.
    obstacle_range_m
        Maximum range for single obstacles [m].
    obstacle_gap_m
        Step in range that ends an obstacle [m].
    obstacle_width_m
        A wider object is a wall [m].

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    patch_near_m: float = 0.02
    patch_depth_m: float = 0.4
    patch_near_width_m: float = 0.3
    patch_far_width_m: float = 0.4
    adaption: float = 0.05
    max_range_m: float = 4.0
    beams: int = 80
    least_height_m: float = 0.04
    least_width_m: float = 0.04
    boundary_sigma_px: float = 0.7
    pitch_sigma_deg: float = 0.1
    calibration_sigma_deg: float = 0.05
    height_sigma: float = 0.005
    obstacle_range_m: float = 2.5
    obstacle_gap_m: float = 0.1
    obstacle_width_m: float = 1.2

    def __post_init__(self) -> None:
        for key in ("patch_near_m", "pitch_sigma_deg", "calibration_sigma_deg", "height_sigma"):
            self._check(key, -1e-12, 10.0)
        for key in (
            "patch_depth_m",
            "patch_near_width_m",
            "patch_far_width_m",
            "obstacle_gap_m",
            "obstacle_width_m",
            "obstacle_range_m",
        ):
            self._check(key, 0.0, 10.0)
        self._check("max_range_m", 0.1, 100.0)
        self._check("least_height_m", 0.001, 1.0)
        self._check("least_width_m", 0.001, 1.0)
        self._check("boundary_sigma_px", 0.0, 50.0)
        if not 0.0 < self.adaption <= 1.0:
            raise InvalidValue(
                "adaption", f"must lie in (0, 1], found {self.adaption}", self.adaption
            )
        if not 1 <= self.beams <= 10_000:
            raise InvalidValue("beams", f"must be 1 to 10000, found {self.beams}", self.beams)

    def _check(self, key: str, above: float, below: float) -> None:
        """Refuse a value that is not strictly between two bounds."""
        value = getattr(self, key)
        if not (math.isfinite(value) and above < value < below):
            low = 0 if above < 0.0 else above
            raise InvalidValue(key, f"must lie between {low:g} and {below:g}, found {value}", value)
