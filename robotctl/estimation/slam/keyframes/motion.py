"""Motion between scans and how sure it is; places in keyframes that it starts from."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from robotctl.estimation.slam.front_end.surface import Floats
from robotctl.estimation.slam.keyframes.config import CalibratedWheels, WheelNoise
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


STEADY_M: Final = 0.1
STEADY_RAD: Final = 0.1
SURPRISE_M: Final = 0.5
SURPRISE_RAD: Final = 0.5
"""Limits of the standard deviation of a motion that nothing but scans measure [m], [rad]."""
_NEWEST: Final = 0.2
"""Share of the newest motion in what is expected of the next."""


def by_odometry(motion: SE2, noise: WheelNoise | CalibratedWheels) -> PredictedMotion:
    """Return the motion that odometry measured."""
    distance, turn = math.hypot(motion.x_m, motion.y_m), abs(motion.theta_rad)
    return PredictedMotion(motion, noise.sigma_m(distance, turn), noise.sigma_rad(distance, turn))


class MotionHabit:
    """Motion to the next scan without odometry, as far as the motions before it tell.

    Three guesses: the last motion again, as some logs take a scan each half metre; its velocity for
    the time since; none. The one that has been the nearest to the motions that scans measured is
    the prediction, and its errors are the uncertainty. So stamps only count where they help: equal,
    missing or wrong ones lead to worse guesses than none.
    """

    def __init__(self, most: float) -> None:
        self._most = most
        self._last, self._last_s = SE2(), 0.0
        self._guesses = [SE2()] * 3
        self._squares = np.full((3, 2), SURPRISE_M**2)

    def predict(self, now_s: float) -> PredictedMotion:
        """Return the motion in the time since the last scan [s]."""
        share = 1.0
        if self._last_s > 0.0 and now_s > 0.0:
            share = min(now_s / self._last_s, self._most)
        at_velocity = SE2.exp(*(share * each for each in self._last.log()))
        self._guesses = [self._last, at_velocity, SE2()]
        best = int(np.argmin(self._squares.sum(axis=1)))
        off_m, off_rad = np.sqrt(self._squares[best]).tolist()
        return PredictedMotion(
            self._guesses[best],
            min(max(off_m, STEADY_M), SURPRISE_M),
            min(max(off_rad, STEADY_RAD), SURPRISE_RAD),
        )

    def learn(self, motion: SE2, took_s: float) -> None:
        """Compare the guesses with the motion that a scan measured, which took so long [s]."""
        offs = [guess.inverse() @ motion for guess in self._guesses]
        new = np.array([(off.x_m**2 + off.y_m**2, off.theta_rad**2) for off in offs])
        self._squares += _NEWEST * (np.minimum(new, 4.0 * SURPRISE_M**2) - self._squares)
        self._last, self._last_s = motion, took_s

    def forget(self) -> None:
        """Expect nothing: the robot may have moved otherwise meanwhile."""
        self._last, self._last_s = SE2(), 0.0
        self._squares[:] = SURPRISE_M**2


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

    def moved_to(
        self, odometry: SE2 | None, noise: WheelNoise | CalibratedWheels
    ) -> PredictedMotion | None:
        """Return `base` in the keyframe, with `base` in `odom` now; None if either is unknown."""
        if self.odometry is None or odometry is None:
            return None
        wheels = by_odometry(self.odometry.inverse() @ odometry, noise)
        moved = replace(wheels, motion=self.pose @ wheels.motion)
        if self.uncertainty is None:
            return moved
        away_m = math.hypot(wheels.motion.x_m, wheels.motion.y_m)
        return moved.widened(self.uncertainty, away_m)
