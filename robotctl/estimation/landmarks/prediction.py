"""The prediction of a filter with the state of `models`: motion, its noise, and calibration."""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.kalman.growing_gaussian import GrowingGaussian
from robotctl.estimation.landmarks.config import LandmarkConfig
from robotctl.estimation.landmarks.learned_noise import LearnedNoise
from robotctl.estimation.landmarks.models import OdometryReading, S, moved
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.pose_estimate import PoseEstimate

Array: TypeAlias = NDArray[np.float64]


class Prediction(NamedTuple):
    """The state after a motion, its Jacobian F, its noise Q; length [m] and turn [rad]."""

    x: Array
    F: Array
    Q: Array
    distance_m: float
    turn_rad: float


def between_states(about: Array, x: Array) -> Array:
    """Return the difference of a state from another, (n,), on the circle in its heading."""
    off = x - about
    off[S.THETA] = wrap_angle(float(off[S.THETA]))
    return off


class CalibratedRobot:
    """The belief in pose and calibration of a robot, and how it moves.

    Parameters
    ----------
    config
        Priors of odometry and camera.
    start
        Prior of the pose.
    """

    def __init__(self, config: LandmarkConfig, start: PoseEstimate) -> None:
        self.config = config
        self.stamp_ns = start.stamp_ns
        """Time of the belief [ns]."""
        x, sigma = config.calibration()
        P = np.diag(sigma**2)
        x[:3] = start.pose.x_m, start.pose.y_m, start.pose.theta_rad
        P[:3, :3] = start.covariance
        self.start = x, P
        """Prior of the state, (n,) and (n, n)."""
        self.noise = LearnedNoise(config, len(x))
        """Noises of motion and sightings."""
        self._walk = sigma**2 / config.calibration_holds_s  # growth of the variances [1/s]
        self._walk[[S.X, S.Y, S.THETA, S.WANDER]] = 0.0

    def move(
        self,
        belief: GrowingGaussian,
        stamp_ns: int,
        begin: OdometryReading,
        end: OdometryReading,
        about: Array | None = None,
    ) -> Prediction:
        """Move a belief, whose first states are the robot's, until a time [ns].

        Parameters
        ----------
        begin, end
            What odometry had counted `delay` before the time of the belief, and before the new one.
        about
            State about which the motion is linearised, (n,); None: that of the belief.

        Raises
        ------
        ValueError
            If the time goes back.
        """
        if stamp_ns < self.stamp_ns:
            raise ValueError(f"time goes back: {stamp_ns} ns after {self.stamp_ns} ns")
        dt_s = 1e-9 * (stamp_ns - self.stamp_ns)
        x = belief.x[: len(S)]
        made = self.prediction(x if about is None else about, begin, end, dt_s)
        if about is not None:
            made = made._replace(x=made.x + made.F @ between_states(about, x))
        belief.predict(made.x, made.F, made.Q)
        self.noise.moved(made.F, made.Q, dt_s)
        self.stamp_ns = stamp_ns
        return made

    def prediction(
        self, x: Array, begin: OdometryReading, end: OdometryReading, dt_s: float
    ) -> Prediction:
        """Return where what odometry counted within some time [s] takes a state (n,)."""
        config = self.config
        after, F, G, distance_m, turn_rad = moved(x, begin, end)
        kept = math.exp(-dt_s / config.wander_time_s)
        after[S.WANDER] *= kept
        F[S.WANDER, S.WANDER] = kept
        noise, factor = config.motion, self.noise.motion_factor**2
        along = noise.e_m_per_sqrt_m**2 * abs(distance_m)
        turning = noise.f_rad_per_sqrt_m**2 * abs(distance_m)
        turning += noise.g_rad_per_sqrt_rad**2 * abs(turn_rad)
        turning += config.standing_rad_per_sqrt_s**2 * dt_s
        Q = np.diag(self._walk * dt_s)
        Q[:3, :3] = (G * (factor * along, factor * turning)) @ G.T
        Q[S.WANDER, S.WANDER] = config.wander_sigma_rad**2 * (1.0 - kept**2)
        return Prediction(after, F, Q, distance_m, turn_rad)
