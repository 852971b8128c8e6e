"""Odometry as the only estimate: a pose by dead reckoning, with a covariance that grows.

For the navigation process. It adds a covariance to odometry; the control process's own
`odometry.py` knows the pose alone.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from robotctl.model.drives.motion import arc
from robotctl.model.drives.motion_noise import MotionNoise, propagate
from robotctl.model.geometry.angles import sinc
from robotctl.model.geometry.pose_estimate import LocalisationStatus, PoseEstimate
from robotctl.model.geometry.se2 import SE2


class OdometryEstimate:
    """Pose of `base` in `world` by dead reckoning, with the covariance of `motion_noise.py`.

    Each motion is an arc with the errors e, f and g all along it (`motion_noise.py`), so neither
    pose nor covariance depends on how the path is divided. The errors are assumed white: a wrong
    track width causes an error of another kind, which this covariance does not include; calibrate
    first. The status is always LOCALISED: odometry never doubts itself.

    Parameters
    ----------
    noise
        The three noises.
    start
        Prior of the pose.
    """

    def __init__(self, noise: MotionNoise, start: PoseEstimate) -> None:
        self._noise = noise
        self._odometry: SE2 | None = None
        self.reset(start)

    def reset(self, estimate: PoseEstimate) -> None:
        """Continue from another pose and covariance; the odometry continues."""
        self._stamp_ns = estimate.stamp_ns
        self._pose = estimate.pose
        self._covariance: NDArray[np.float64] = estimate.covariance

    @property
    def estimate(self) -> PoseEstimate:
        """The present estimate."""
        return PoseEstimate(
            self._stamp_ns, self._pose, self._covariance, LocalisationStatus.LOCALISED
        )

    def move(self, distance_m: float, angle_rad: float, stamp_ns: int) -> PoseEstimate:
        """Drive an arc of a length [m] and a turn [rad], until a time [ns]."""
        self._covariance = propagate(
            self._covariance, self._pose, distance_m, angle_rad, self._noise
        )
        self._pose = arc(self._pose, distance_m, angle_rad)
        self._stamp_ns = stamp_ns
        return self.estimate

    def follow(self, odometry: SE2, stamp_ns: int) -> PoseEstimate:
        """Move as an odometry moved since the last call; the first call only takes its pose.

        The pose moves exactly as the odometry, the covariance along the arc between the poses.

        Parameters
        ----------
        odometry
            `base` in the frame of the odometry, whose origin may be anywhere.
        stamp_ns
            Time of it [ns].
        """
        if self._odometry is not None:
            T_last_now = self._odometry.inverse() @ odometry
            distance_m, angle_rad = arc_between(T_last_now)
            self._covariance = propagate(
                self._covariance, self._pose, distance_m, angle_rad, self._noise
            )
            self._pose = self._pose @ T_last_now
        self._odometry = odometry
        self._stamp_ns = stamp_ns
        return self.estimate


def arc_between(T_last_now: SE2) -> tuple[float, float]:
    """Return length [m] and turn [rad] of the arc that ends nearest to a relative pose.

    Negative length if the robot moved backwards. A turn beyond half a circle between two poses
    cannot be recognised.
    """
    angle_rad = T_last_now.theta_rad
    half = 0.5 * angle_rad
    chord_m = T_last_now.x_m * math.cos(half) + T_last_now.y_m * math.sin(half)
    return chord_m / sinc(half), angle_rad
