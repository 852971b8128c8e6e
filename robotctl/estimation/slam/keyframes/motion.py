"""Prediction of the robot's pose: by odometry, or by its motion so far."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from robotctl.estimation.slam.front_end.surface import Floats
from robotctl.estimation.slam.keyframes.config import WheelNoise
from robotctl.model.geometry.se2 import SE2

_LONGEST: Final = 1.5
"""At most so many times the last motion is expected: after a pause, or if a clock jumps."""


@dataclass(frozen=True, slots=True)
class Expected:
    """A motion since the last scan, and how sure it is.

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
        """(3, 3), in the frame of the pose."""
        return np.diag([self.sigma_m**-2, self.sigma_m**-2, self.sigma_rad**-2])

    @property
    def covariance(self) -> Floats:
        """(3, 3), in the frame of the pose."""
        return np.diag([self.sigma_m**2, self.sigma_m**2, self.sigma_rad**2])

    def doubted(self, other: Expected, away_m: float = 0.0) -> Expected:
        """Return the motion with the doubt of another one, too, that ended so far from its end."""
        return Expected(
            self.motion,
            math.hypot(self.sigma_m, other.sigma_m, other.sigma_rad * away_m),
            math.hypot(self.sigma_rad, other.sigma_rad),
        )


def by_odometry(motion: SE2, noise: WheelNoise) -> Expected:
    """Return what wheels say."""
    distance, turn = math.hypot(motion.x_m, motion.y_m), abs(motion.theta_rad)
    return Expected(motion, noise.sigma_m(distance, turn), noise.sigma_rad(distance, turn))


@dataclass(frozen=True, slots=True)
class Place:
    """Place of a scan: a pose of `base` in a keyframe."""

    stamp_ns: int
    keyframe: int
    pose: SE2


@dataclass(frozen=True, slots=True)
class Kept:
    """Pose in a keyframe from which odometry leads on.

    Parameters
    ----------
    pose
        Of `base` in the keyframe.
    odometry
        `base` in `odom` then; None: not known.
    doubt
        How well the pose is known; None: as the keyframe itself.
    """

    pose: SE2 = field(default_factory=SE2)
    odometry: SE2 | None = None
    doubt: Expected | None = None

    def moved_to(self, odometry: SE2 | None, noise: WheelNoise) -> Expected | None:
        """Return `base` in the keyframe, with `base` in `odom` now; None if either is not known."""
        if self.odometry is None or odometry is None:
            return None
        wheels = by_odometry(self.odometry.inverse() @ odometry, noise)
        moved = replace(wheels, motion=self.pose @ wheels.motion)
        if self.doubt is None:
            return moved
        return moved.doubted(self.doubt, math.hypot(wheels.motion.x_m, wheels.motion.y_m))


def by_velocity(last: SE2, last_s: float, now_s: float) -> Expected:
    """Return the motion at the velocity of the last one, or somewhat more than the last one.

    Parameters
    ----------
    last, last_s
        The last motion, and how long it took [s]; 0: not known.
    now_s
        Time since [s].
    """
    if last_s <= 0.0:
        return Expected(SE2(), min(0.05 + 0.5 * now_s, 0.5), min(0.05 + 0.5 * now_s, 0.5))
    share = min(now_s / last_s, _LONGEST)
    rho_x, rho_y, theta = (share * each for each in last.log())
    return Expected(
        SE2.exp(rho_x, rho_y, theta),
        min(0.03 + 0.25 * now_s**2 + 0.2 * math.hypot(rho_x, rho_y), 0.5),
        min(0.03 + 0.8 * now_s**2 + 0.2 * abs(theta), 0.5),
    )
