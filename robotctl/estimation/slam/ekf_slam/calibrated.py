"""EKF-SLAM of points by a camera and an odometry that are calibrated on the way.

As `landmarks.ekf.LandmarkEkf`, but nobody knows where the landmarks are, or which is seen. Without
a known map nothing tells the scale of the ranges from that of the map; what seems to tell is
rounding of the linearisation. So this state is considered and not estimated.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.kalman.adaptive_noise import AdaptiveVariance, MotionNoiseFactor
from robotctl.estimation.landmarks.config import LandmarkConfig
from robotctl.estimation.landmarks.models import OdometryReading, S
from robotctl.estimation.landmarks.prediction import Prediction, predict, walk_of
from robotctl.estimation.slam.ekf_slam.camera_points import CAMERA_POINT
from robotctl.estimation.slam.ekf_slam.filter import EkfSlam
from robotctl.model.geometry.pose_estimate import PoseEstimate

Array: TypeAlias = NDArray[np.float64]

_SCALES = (int(S.RANGE_SCALE),)


class CalibratedSlam:
    """The joint belief in pose, calibration and landmarks of a robot with a camera.

    Parameters
    ----------
    config
        Priors of odometry and camera.
    start
        Prior of the pose.
    """

    def __init__(self, config: LandmarkConfig, start: PoseEstimate) -> None:
        self._config = config
        x, sigma = config.calibration()
        P = np.diag(sigma**2)
        x[:3] = start.pose.x_m, start.pose.y_m, start.pose.theta_rad
        P[:3, :3] = start.covariance
        self.slam = EkfSlam(x, P, considered=_SCALES)
        """The filter."""
        self._walk = walk_of(config)
        self._variances = tuple(
            AdaptiveVariance(config.guess_sightings, config.forgetting_s) for _ in range(2)
        )
        self._motion_factor = MotionNoiseFactor(config.motion_guess_sigma, config.forgetting_s)
        self._since = np.zeros_like(P)
        self._stamp_ns = start.stamp_ns

    @property
    def delay_s(self) -> float:
        """How long before a time its motion is in the odometry [s]."""
        return float(self.slam.belief.x_v[S.DELAY])

    @property
    def motion_noise_factor(self) -> float:
        """Standard deviations that the motion is taken to have, over the configured ones, >= 1."""
        return math.sqrt(max(1.0, self._config.correlation * self._motion_factor.factor))

    def noise(self, z: Array) -> Array:
        """Return the noises of measurements (m, 2), as learned, (m, 2, 2)."""
        return self._guess(z) * (self._factors() * self._config.correlation)[:, np.newaxis]

    def predict(self, stamp_ns: int, begin: OdometryReading, end: OdometryReading) -> Prediction:
        """Move until a time [ns] by odometry between two readings, each `delay_s` before its time.

        Raises
        ------
        ValueError
            If the time goes back.
        """
        if stamp_ns < self._stamp_ns:
            raise ValueError(f"time goes back: {stamp_ns} ns after {self._stamp_ns} ns")
        dt_s = 1e-9 * (stamp_ns - self._stamp_ns)
        made = self.prediction(self.slam.belief.x_v, begin, end, dt_s)
        self.slam.predict(made.x, made.F, made.Q)
        self._since = made.F @ self._since @ made.F.T
        self._since[:3, :3] += made.Q[:3, :3]
        self._motion_factor.fade(dt_s)
        for variance in self._variances:
            variance.fade(dt_s)
        self._stamp_ns = stamp_ns
        return made

    def prediction(
        self, x: Array, begin: OdometryReading, end: OdometryReading, dt_s: float
    ) -> Prediction:
        """Return where a motion of some time [s] takes a state (nv,)."""
        factor = self.motion_noise_factor
        return predict(x, begin, end, dt_s, self._config, self._walk, factor)

    def correct(self, which: NDArray[np.int64], z: Array) -> float:
        """Correct by measurements (m, 2) of known features (m,), all of now; return their NIS."""
        slam, belief = self.slam, self.slam.belief
        R = self.noise(z)
        expected, by_robot, by_feature = CAMERA_POINT.expected(belief.x_v, belief.features[which])
        innovations = CAMERA_POINT.residual(z, expected)
        G = belief.innovation_covariances(which, by_robot, by_feature)
        nis = slam.update(CAMERA_POINT, which, z, R)
        self._learn_motion(innovations, by_robot, G, R)
        self._learn(which, z)
        return nis

    def add(self, name: int | str, z: Array) -> int:
        """Add the feature of a measurement (2,); return its number."""
        return self.slam.add(CAMERA_POINT, name, z, self.noise(z[np.newaxis])[0])

    def _factors(self) -> Array:
        return np.array([variance.factor for variance in self._variances])

    def _guess(self, z: Array) -> Array:
        """Return the configured noises, (m, 2, 2)."""
        c = self._config
        sigma = np.empty_like(z)
        sigma[:, 0] = c.sighting_range_sigma_m + c.sighting_range_sigma_m_per_m * z[:, 0]
        sigma[:, 1] = c.sighting_bearing_sigma_rad
        return np.eye(2) * (sigma**2)[:, np.newaxis]

    def _learn(self, which: NDArray[np.int64], z: Array) -> None:
        """Learn the noise from the residuals after the update, and what is uncertain of them."""
        belief = self.slam.belief
        expected, by_robot, by_feature = CAMERA_POINT.expected(belief.x_v, belief.features[which])
        by_robot[:, :, _SCALES] = 0.0  # the features have it too, and it does not show
        residual = CAMERA_POINT.residual(z, expected)
        left = belief.innovation_covariances(which, by_robot, by_feature)
        squares = residual**2 + np.diagonal(left, axis1=1, axis2=2) / self._config.correlation
        squares /= np.diagonal(self._guess(z), axis1=1, axis2=2)
        for variance, column in zip(self._variances, squares.T.tolist(), strict=True):
            for square in column:
                variance.add(square)

    def _learn_motion(self, innovations: Array, by_robot: Array, G: Array, R: Array) -> None:
        """Learn the noise of the motion since the last sighting."""
        share = self._motion_factor.factor / self.motion_noise_factor**2
        for off, H, whole, noise in zip(innovations, by_robot, G, R, strict=True):
            taken = H @ self._since @ H.T
            learned = share * taken
            S_ = whole + noise / self._config.correlation - taken + learned
            self._motion_factor.add(off, S_, learned)
        self._since[:] = 0.0
