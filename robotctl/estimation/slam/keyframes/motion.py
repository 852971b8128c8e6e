"""Motion between scans and how sure it is; places in keyframes that it starts from."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from robotctl.estimation.slam.front_end.surface import Floats
from robotctl.estimation.slam.keyframes.config import WheelNoise
from robotctl.model.geometry.se2 import SE2


@dataclass(frozen=True, slots=True)
class PredictedMotion:
    """Motion since the last scan, and how sure it is.

    Parameters
    ----------
    motion
        Pose of `base` now in `base` then.
    sigma_m, sigma_rad
        Standard deviations [m], [rad].
    """

    motion: SE2
    sigma_m: float
    sigma_rad: float

    @property
    def information(self) -> Floats:
        """Information (3, 3), in the frame of the pose."""
        return np.diag([self.sigma_m**-2, self.sigma_m**-2, self.sigma_rad**-2])

    @property
    def covariance(self) -> Floats:
        """Covariance (3, 3), in the frame of the pose."""
        return np.diag([self.sigma_m**2, self.sigma_m**2, self.sigma_rad**2])

    def widened(self, other: PredictedMotion, away_m: float = 0.0) -> PredictedMotion:
        """Return the motion with the uncertainty of another one added, which ended `away_m` off."""
        return PredictedMotion(
            self.motion,
            math.hypot(self.sigma_m, other.sigma_m, other.sigma_rad * away_m),
            math.hypot(self.sigma_rad, other.sigma_rad),
        )


CONTRADICTS: Final = 16.27
"""Chi-squared value of 3 degrees of freedom that one sample in a thousand exceeds."""
AFTER_A_BREAK: Final = PredictedMotion(SE2(), 0.5, 0.17)
"""Motion of a robot during a break: it may have rolled on before it came to rest."""


def by_odometry(motion: SE2, noise: WheelNoise) -> PredictedMotion:
    """Return the motion that odometry measured."""
    distance, turn = math.hypot(motion.x_m, motion.y_m), abs(motion.theta_rad)
    return PredictedMotion(motion, noise.sigma_m(distance, turn), noise.sigma_rad(distance, turn))


def by_velocity(last: SE2, last_s: float, now_s: float, most: float) -> PredictedMotion:
    """Return the motion at the velocity of the last one, or somewhat more than the last one.

    Parameters
    ----------
    last, last_s
        The last motion, and how long it took [s]; 0: unknown.
    now_s
        Time since [s].
    most
        Maximum multiple of the last motion.
    """
    if last_s <= 0.0:
        sigma = min(0.05 + 0.5 * now_s, 0.5)
        return PredictedMotion(SE2(), sigma, sigma)
    share = min(now_s / last_s, most)
    rho_x, rho_y, theta = (share * each for each in last.log())
    return PredictedMotion(
        SE2.exp(rho_x, rho_y, theta),
        min(0.03 + 0.25 * now_s**2 + 0.2 * math.hypot(rho_x, rho_y), 0.5),
        min(0.03 + 0.8 * now_s**2 + 0.2 * abs(theta), 0.5),
    )


@dataclass(frozen=True, slots=True)
class ScanPose:
    """Place of a scan: a pose of `base` in a keyframe."""

    stamp_ns: int
    keyframe: int
    pose: SE2


@dataclass(frozen=True, slots=True)
class OdometryAnchor:
    """Pose in a keyframe from which odometry leads on.

    Parameters
    ----------
    pose
        `base` in the keyframe.
    odometry
        `base` in `odom` at that time; None: unknown.
    uncertainty
        How well the pose is known; None: as well as the keyframe itself.
    """

    pose: SE2 = field(default_factory=SE2)
    odometry: SE2 | None = None
    uncertainty: PredictedMotion | None = None

    def moved_to(self, odometry: SE2 | None, noise: WheelNoise) -> PredictedMotion | None:
        """Return `base` in the keyframe, with `base` in `odom` now; None if either is unknown."""
        if self.odometry is None or odometry is None:
            return None
        wheels = by_odometry(self.odometry.inverse() @ odometry, noise)
        moved = replace(wheels, motion=self.pose @ wheels.motion)
        if self.uncertainty is None:
            return moved
        away_m = math.hypot(wheels.motion.x_m, wheels.motion.y_m)
        return moved.widened(self.uncertainty, away_m)
