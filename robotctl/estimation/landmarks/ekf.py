"""Localisation by ranges and bearings of known landmarks, calibrating the sensors meanwhile."""

from __future__ import annotations

import math
from collections import deque
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.kalman.adaptive_noise import AdaptiveVariance, MotionNoiseFactor
from robotctl.estimation.kalman.consistency import InnovationWindow
from robotctl.estimation.kalman.ekf_models import bearing_residual
from robotctl.estimation.kalman.robust_kalman import Innovation, RobustKalman
from robotctl.estimation.landmarks.config import LandmarkConfig
from robotctl.estimation.landmarks.fix import SeenLandmark, pose_from_landmarks
from robotctl.estimation.landmarks.models import OdometryReading, S, sighting
from robotctl.estimation.landmarks.prediction import predict, walk_of
from robotctl.model.drives.motion import arc
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.pose_estimate import LocalisationStatus, PoseEstimate
from robotctl.model.geometry.se2 import SE2

Array: TypeAlias = NDArray[np.float64]

_FIX_SPAN_NS = 10_000_000_000
"""Sightings this close to each other make a new start together."""


class LandmarkEkf:
    """Extended Kalman filter of a pose and of the errors of odometry and camera.

    The models stand in `models.py`. The noise of the sightings is learned from their residuals.
    While the innovations contradict the belief, odometry alone moves it, until sightings of several
    landmarks make a new start; the calibration is kept.

    Parameters
    ----------
    config
        Priors.
    start
        Prior of the pose.
    """

    def __init__(self, config: LandmarkConfig, start: PoseEstimate) -> None:
        self._config = config
        mean, sigma = config.calibration()
        P = np.diag(sigma**2)
        mean[:3] = start.pose.x_m, start.pose.y_m, start.pose.theta_rad
        P[:3, :3] = start.covariance
        self._walk = walk_of(config)
        self._kalman = RobustKalman(mean, P, config.robust, opening_states=3)
        self._window = InnovationWindow(config.window)
        self._variances = tuple(
            AdaptiveVariance(config.guess_sightings, config.forgetting_s) for _ in range(2)
        )
        self._motion_factor = MotionNoiseFactor(config.motion_guess_sigma, config.forgetting_s)
        self._since = np.zeros_like(P)  # what the motion's noise added since the last sighting
        self._seen: deque[SeenLandmark] = deque()
        self._trusted = deque([(mean, P)], maxlen=config.window)
        self._stamp_ns = start.stamp_ns
        self.restarts = 0
        """How often the pose was found again."""

    @property
    def x(self) -> Array:
        """State, in the order of `landmark_models.S`."""
        return self._kalman.x.copy()

    @property
    def sigma(self) -> Array:
        """Standard deviations of the state."""
        return np.sqrt(np.diag(self._kalman.P))

    @property
    def delay_s(self) -> float:
        """How long before a time its motion is in the odometry [s]."""
        return float(self._kalman.x[S.DELAY])

    @property
    def noise_factors(self) -> tuple[float, float]:
        """Learned standard deviations of range and bearing, over the configured ones."""
        ranges, bearings = self._variances
        return math.sqrt(ranges.factor), math.sqrt(bearings.factor)

    @property
    def motion_noise_factor(self) -> float:
        """Standard deviations that the motion is taken to have, over the configured ones, >= 1.

        What is learned between sightings close to each other misses that errors of the motion last,
        and so add up faster than white noise where nothing is seen. So it counts `correlation`
        times, and never for less than the guess.
        """
        return math.sqrt(max(1.0, self._config.correlation * self._motion_factor.factor))

    def estimate(self) -> PoseEstimate:
        """Return the pose estimate, including the uncertainty of map and reference."""
        x, c = self._kalman.x, self._config
        covariance = self._kalman.P[:3, :3] + np.diag(
            [c.map_sigma_m**2, c.map_sigma_m**2, c.map_sigma_rad**2]
        )
        status = LocalisationStatus.LOCALISED
        if self._window.contradicted:
            status = LocalisationStatus.LOST
        pose = SE2(float(x[S.X]), float(x[S.Y]), wrap_angle(float(x[S.THETA])))
        return PoseEstimate(self._stamp_ns, pose, covariance, status)

    def predict(self, stamp_ns: int, begin: OdometryReading, end: OdometryReading) -> None:
        """Move until a time [ns] by odometry between two readings, each `delay_s` before its time.

        Raises
        ------
        ValueError
            If the time goes back.
        """
        if stamp_ns < self._stamp_ns:
            raise ValueError(f"time goes back: {stamp_ns} ns after {self._stamp_ns} ns")
        kalman = self._kalman
        dt_s = 1e-9 * (stamp_ns - self._stamp_ns)
        after, F, Q, distance_m, turn_rad = predict(
            kalman.x, begin, end, dt_s, self._config, self._walk, self.motion_noise_factor
        )
        kalman.predict(after, F, Q)
        self._since = F @ self._since @ F.T
        self._since[:3, :3] += Q[:3, :3]
        self._motion_factor.fade(dt_s)
        self._stamp_ns = stamp_ns
        for variance in self._variances:
            variance.fade(dt_s)
        delta = arc(SE2(), distance_m, turn_rad).inverse()
        for seen in self._seen:
            seen.move(delta)
        while self._seen and self._seen[0].stamp_ns < stamp_ns - _FIX_SPAN_NS:
            self._seen.popleft()

    def update(
        self, landmark_world: tuple[float, float], range_m: float, bearing_rad: float
    ) -> Innovation:
        """Correct by a sighting of now.

        Raises
        ------
        ValueError
            If range or bearing is not finite, or the range not positive.
        """
        if not (math.isfinite(bearing_rad) and 0.0 < range_m < math.inf):
            raise ValueError(f"sighting must be finite, found {range_m} m, {bearing_rad} rad")
        c, kalman = self._config, self._kalman
        expected, H, distance_m = sighting(kalman.x, landmark_world)
        guess = np.array(
            [
                c.sighting_range_sigma_m + c.sighting_range_sigma_m_per_m * distance_m,
                c.sighting_bearing_sigma_rad,
            ]
        )
        factors = [variance.factor for variance in self._variances]
        z = np.array([range_m, bearing_rad])
        R = np.diag(guess**2 * factors * c.correlation)
        self._seen.append(SeenLandmark(self._stamp_ns, landmark_world, range_m, bearing_rad))
        if self._window.contradicted:
            off = bearing_residual(z, expected)
            nis, weight = float(off @ np.linalg.solve(H @ kalman.P @ H.T + R, off)), 0.0
        else:
            P_before = kalman.P
            nis, weight = kalman.update(z, expected, H, R, bearing_residual)
            if weight > 0.0:
                self._learn_motion(weight * bearing_residual(z, expected), H, P_before, R)
            self._trusted.append((kalman.x, kalman.P))
        if weight > 0.0:
            self._learn(z, landmark_world, guess, weight)
        innovation = Innovation(self._stamp_ns, "landmark", nis, 2, weight)
        self._window.add(innovation)
        if self._window.contradicted:
            self._restart()
        return innovation

    def _learn(
        self, z: Array, landmark_world: tuple[float, float], guess: Array, weight: float
    ) -> None:
        """Learn the noise from the residuals after the update."""
        expected, H, _ = sighting(self._kalman.x, landmark_world)
        residual = bearing_residual(z, expected)
        # the state's share came by sightings whose noise was taken `correlation` times as large
        uncertain = np.einsum("ij,jk,ik->i", H, self._kalman.P, H) / self._config.correlation
        squares = (weight * residual**2 + uncertain) / guess**2
        for variance, square in zip(self._variances, squares.tolist(), strict=True):
            variance.add(square)

    def _learn_motion(self, innovation: Array, H: Array, P: Array, R: Array) -> None:
        """Learn the noise of the motion since the last sighting."""
        taken = H @ self._since @ H.T
        learned = taken * self._motion_factor.factor / self.motion_noise_factor**2
        S = H @ P @ H.T + R / self._config.correlation - taken + learned
        self._motion_factor.add(innovation, S, learned)
        self._since = np.zeros_like(self._since)

    def _restart(self) -> None:
        """Restart from the last sightings, if they determine a pose.

        The calibration is that of before the contradiction, which the wrong pose has not spoilt.
        """
        found = pose_from_landmarks(self._seen)
        if found is None:
            return
        pose, covariance = found
        x, P = (each.copy() for each in self._trusted[0])
        x[:3] = pose.x_m, pose.y_m, pose.theta_rad
        P[:3, :], P[:, :3] = 0.0, 0.0
        P[:3, :3] = covariance
        self._kalman.set(x, P)
        self._window.reset()
        self.restarts += 1
