"""Localisation by ranges and bearings of known landmarks, calibrating the sensors meanwhile."""

from __future__ import annotations

import math
from collections import deque
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.kalman.consistency import InnovationWindow
from robotctl.estimation.kalman.ekf_models import bearing_residual
from robotctl.estimation.kalman.growing_gaussian import GrowingGaussian
from robotctl.estimation.kalman.robust_kalman import Innovation
from robotctl.estimation.landmarks.config import LandmarkConfig
from robotctl.estimation.landmarks.fix import SeenLandmark, pose_from_landmarks
from robotctl.estimation.landmarks.models import OdometryReading, S, sighting
from robotctl.estimation.landmarks.prediction import CalibratedRobot, Prediction, between_states
from robotctl.model.drives.motion import arc
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.pose_estimate import LocalisationStatus, PoseEstimate
from robotctl.model.geometry.se2 import SE2

Array: TypeAlias = NDArray[np.float64]

_FIX_SPAN_NS: Final = 10_000_000_000
"""Sightings this close to each other make a new start together."""
_POSE: Final = np.arange(3)
_STATES: Final = np.arange(len(S))


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
        self._robot = CalibratedRobot(config, start)
        self._belief = GrowingGaussian(*self._robot.start)
        self._window = InnovationWindow(config.window)
        self._seen: deque[SeenLandmark] = deque()
        self._trusted = deque([self._robot.start], maxlen=config.window)
        self.restarts = 0
        """How often the pose was found again."""

    @property
    def x(self) -> Array:
        """State, in the order of `models.S`."""
        return self._belief.x.copy()

    @property
    def P(self) -> Array:
        """Covariance of the state, (n, n)."""
        return self._belief.covariance()

    @property
    def sigma(self) -> Array:
        """Standard deviations of the state."""
        return np.sqrt(np.diag(self.P))

    @property
    def delay_s(self) -> float:
        """How long before a time its motion is in the odometry [s]."""
        return float(self._belief.x[S.DELAY])

    @property
    def noise_factors(self) -> tuple[float, float]:
        """Learned standard deviations of range and bearing, over the configured ones."""
        ranges, bearings = np.sqrt(self._robot.noise.sighting_factors).tolist()
        return ranges, bearings

    @property
    def motion_noise_factor(self) -> float:
        """Standard deviations that the motion is taken to have, over the configured ones, >= 1."""
        return self._robot.noise.motion_factor

    def estimate(self) -> PoseEstimate:
        """Return the pose estimate, including the uncertainty of map and reference."""
        return stated(
            self._config,
            self._robot.stamp_ns,
            self._belief.x,
            self._belief.block(_POSE),
            is_lost=self._window.contradicted,
        )

    def predict(
        self,
        stamp_ns: int,
        begin: OdometryReading,
        end: OdometryReading,
        about: Array | None = None,
    ) -> Prediction:
        """Move until a time [ns] by odometry between two readings, each `delay_s` before its time.

        Linearised about a state (n,), or about the present one.

        Raises
        ------
        ValueError
            If the time goes back.
        """
        made = self._robot.move(self._belief, stamp_ns, begin, end, about)
        delta = arc(SE2(), made.distance_m, made.turn_rad).inverse()
        for seen in self._seen:
            seen.move(delta)
        while self._seen and self._seen[0].stamp_ns < stamp_ns - _FIX_SPAN_NS:
            self._seen.popleft()
        return made

    def update(
        self,
        landmark_world: tuple[float, float],
        range_m: float,
        bearing_rad: float,
        about: Array | None = None,
    ) -> Innovation:
        """Correct by a sighting of now, linearised about a state (n,), or about the present one.

        Raises
        ------
        ValueError
            If range or bearing is not finite, or the range not positive.
        """
        if not (math.isfinite(bearing_rad) and 0.0 < range_m < math.inf):
            raise ValueError(f"sighting must be finite, found {range_m} m, {bearing_rad} rad")
        stamp_ns, noise = self._robot.stamp_ns, self._robot.noise
        z = np.array([range_m, bearing_rad])
        self._seen.append(SeenLandmark(stamp_ns, landmark_world, range_m, bearing_rad))
        at = self._belief.x if about is None else about
        expected, H, distance_m = sighting(at, landmark_world)
        off = bearing_residual(z, expected) - H @ between_states(at, self._belief.x)
        R = noise.of_sightings(np.array([distance_m]))
        (G,) = self._belief.innovation_covariances(_STATES[np.newaxis], H[np.newaxis])
        nis, weight = float(off @ np.linalg.solve(G + R[0], off)), 0.0
        if not self._window.contradicted:
            weight = self._config.robust.weight(nis, len(off))
            self._correct(H, off, G, R[0], weight)
            if weight > 0.0:
                noise.learn_motion(weight * off[np.newaxis], H[np.newaxis], G[np.newaxis], R)
            self._trusted.append((self.x, self.P))
        if weight > 0.0:
            self._learn(z, landmark_world, noise.guess(np.array([distance_m])), weight)
        innovation = Innovation(stamp_ns, "landmark", nis, 2, weight)
        self._window.add(innovation)
        if self._window.contradicted:
            self._restart()
        return innovation

    def _correct(self, H: Array, off: Array, G: Array, R: Array, weight: float) -> None:
        """Correct by an innovation that gets a weight; one that is kept out opens the pose."""
        if weight == 0.0:
            opened = np.ones(len(S))
            opened[_POSE] = math.sqrt(self._config.robust.opening)
            P = self.P * np.outer(opened, opened)
            self._belief.set_block(_STATES, P)
            return
        # S times 1 / weight makes the gain smaller by the weight.
        R = R + (1.0 / weight - 1.0) * (G + R)
        self._belief.update(_STATES[np.newaxis], H[np.newaxis], off[np.newaxis], R[np.newaxis])

    def _learn(
        self, z: Array, landmark_world: tuple[float, float], sigma: Array, weight: float
    ) -> None:
        """Learn the noise from the residuals after the update."""
        expected, H, _ = sighting(self._belief.x, landmark_world)
        residual = math.sqrt(weight) * bearing_residual(z, expected)
        left = self._belief.innovation_covariances(_STATES[np.newaxis], H[np.newaxis])
        self._robot.noise.learn_sightings(residual[np.newaxis], left, sigma)

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
        self._belief = GrowingGaussian(x, P)
        self._window.reset()
        self.restarts += 1


def stated(
    config: LandmarkConfig, stamp_ns: int, x: Array, covariance: Array, *, is_lost: bool
) -> PoseEstimate:
    """Return what is said of a belief: state x (n,) and covariance of its pose (3, 3).

    SEARCHING where the belief is too wide to say at which place the robot is.
    """
    c = config
    covariance = covariance + np.diag([c.map_sigma_m**2, c.map_sigma_m**2, c.map_sigma_rad**2])
    status = LocalisationStatus.LOCALISED
    if is_lost:
        status = LocalisationStatus.LOST
    elif (
        covariance[0, 0] + covariance[1, 1] > 2.0 * c.searching_sigma_m**2
        or covariance[2, 2] > c.searching_sigma_rad**2
    ):
        status = LocalisationStatus.SEARCHING
    pose = SE2(float(x[S.X]), float(x[S.Y]), wrap_angle(float(x[S.THETA])))
    return PoseEstimate(stamp_ns, pose, covariance, status)
