"""Settings of localisation by landmarks."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.kalman.robust_kalman import RobustConfig
from robotctl.estimation.landmarks.models import S
from robotctl.model.drives.motion_noise import MotionNoise


@dataclass(frozen=True, slots=True)
class LandmarkConfig:
    """Priors of a robot that sees landmarks: wide, to fit unknown robots.

    Parameters
    ----------
    motion
        Noise of the odometry: of velocities that were commanded, more than of counted wheels.
    motion_guess_sigma
        How uncertain that is: standard deviation of the logarithm of a factor on its variances,
        which is learned, > 0.
    standing_rad_per_sqrt_s
        Walk of the heading whatever odometry says [rad after 1 s], > 0.
    odometry_sigma
        Of scales of distance and turns, of slip [m/rad] and of drift [rad/m], at the start, > 0.
    delay_sigma_s
        Of the time that odometry is ahead [s], > 0.
    range_offset_sigma_m, range_scale_sigma, arm_sigma_m
        Of the camera's constant range error [m], its scale, and its position [m], > 0.
    bearing_sigma_rad
        Of bearing offset, bearing scale, and optical axis [rad], > 0.
    wander_sigma_rad, wander_time_s
        Of what moves in the mount [rad], and how fast [s], > 0.
    calibration_holds_s
        Time without sightings after which a calibration is as uncertain as at the start [s], > 0.
    sighting_range_sigma_m, sighting_range_sigma_m_per_m, sighting_bearing_sigma_rad
        First guess of the noise of a sighting [m], [rad], > 0; adapted to what is seen.
    guess_sightings
        How many sightings that first guess counts for, > 0.
    forgetting_s
        After which time what was seen of the noise is half forgotten [s], > 0.
    correlation
        Factor on the noise, >= 1: the errors of sightings soon after each other are alike. With
        a correlation c from each to the next it is (1 + c) / (1 - c); 2 is c = 1/3.
    map_sigma_m, map_sigma_rad
        How well map and reference agree [m], [rad], >= 0: part of the stated covariance, as no
        sighting can lessen it.
    searching_sigma_m, searching_sigma_rad
        Standard deviations of the position [m] and the heading [rad] beyond which the pose is a
        guess, > 0: a third of what another place is off, so that the robot is there at 99.7 %.
    robust
        Treatment of large innovations.
    window
        Innovations that say whether the belief is contradicted, > 0.
    step_s
        Longest step of the prediction [s], > 0.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    motion: MotionNoise = field(default_factory=lambda: MotionNoise(0.04, 0.06, 0.1))
    motion_guess_sigma: float = 0.7
    standing_rad_per_sqrt_s: float = 1e-3
    odometry_sigma: float = 0.1
    delay_sigma_s: float = 0.2
    range_offset_sigma_m: float = 0.05
    range_scale_sigma: float = 0.05
    arm_sigma_m: float = 0.05
    bearing_sigma_rad: float = 0.03
    wander_sigma_rad: float = 0.02
    wander_time_s: float = 10.0
    calibration_holds_s: float = 3600.0
    sighting_range_sigma_m: float = 0.01
    sighting_range_sigma_m_per_m: float = 0.01
    sighting_bearing_sigma_rad: float = 0.01
    guess_sightings: float = 20.0
    forgetting_s: float = 300.0
    correlation: float = 2.0
    map_sigma_m: float = 0.02
    map_sigma_rad: float = 0.015
    searching_sigma_m: float = 0.33
    searching_sigma_rad: float = 0.175
    robust: RobustConfig = field(default_factory=RobustConfig)
    window: int = 20
    step_s: float = 0.1

    def __post_init__(self) -> None:
        for key in self.__slots__:
            value = getattr(self, key)
            if not isinstance(value, (int, float)):
                continue
            least = 1.0 if key == "correlation" else 0.0
            inside = (
                value >= least
                if key in {"correlation", "map_sigma_m", "map_sigma_rad"}
                else (value > 0.0)
            )
            if not (math.isfinite(value) and inside):
                raise ValueError(f"{key}: {value} found, out of its range")

    def calibration(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return mean and standard deviations of the state before anything is seen, pose 0."""
        mean, sigma = np.zeros(len(S)), np.zeros(len(S))
        mean[S.DEPTH_SHARE], sigma[S.DEPTH_SHARE] = 0.5, 0.5  # distance or depth
        sigma[S.DISTANCE_SCALE : S.DELAY] = self.odometry_sigma
        sigma[S.DELAY] = self.delay_sigma_s
        sigma[S.RANGE_OFFSET], sigma[S.RANGE_SCALE] = (
            self.range_offset_sigma_m,
            self.range_scale_sigma,
        )
        sigma[[S.AXIS, S.BEARING_OFFSET, S.BEARING_SCALE]] = self.bearing_sigma_rad
        sigma[[S.ARM_X, S.ARM_Y]] = self.arm_sigma_m
        sigma[S.WANDER] = self.wander_sigma_rad
        return mean, sigma
