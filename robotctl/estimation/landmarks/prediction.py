"""The prediction of a filter with the state of `models`: motion, its noise, and calibration."""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.landmarks.config import LandmarkConfig
from robotctl.estimation.landmarks.models import OdometryReading, S, moved

Array: TypeAlias = NDArray[np.float64]


class Prediction(NamedTuple):
    """The state after a motion, its Jacobian F, its noise Q; length [m] and turn [rad]."""

    x: Array
    F: Array
    Q: Array
    distance_m: float
    turn_rad: float


def walk_of(config: LandmarkConfig) -> Array:
    """Return how fast the variances of the calibration grow, (n,) [1/s]; that of the pose not."""
    _, sigma = config.calibration()
    walk = sigma**2 / config.calibration_holds_s
    walk[[S.X, S.Y, S.THETA, S.WANDER]] = 0.0
    return walk


def predict(
    x: Array,
    begin: OdometryReading,
    end: OdometryReading,
    dt_s: float,
    config: LandmarkConfig,
    walk: Array,
    motion_factor: float,
) -> Prediction:
    """Move a state (n,) by what odometry counted between two readings, `dt_s` apart [s].

    Parameters
    ----------
    walk
        See `walk_of`.
    motion_factor
        On the standard deviations of the motion.
    """
    after, F, G, distance_m, turn_rad = moved(x, begin, end)
    kept = math.exp(-dt_s / config.wander_time_s)
    after[S.WANDER] *= kept
    F[S.WANDER, S.WANDER] = kept
    noise, factor = config.motion, motion_factor**2
    along = noise.e_m_per_sqrt_m**2 * abs(distance_m)
    turning = noise.f_rad_per_sqrt_m**2 * abs(distance_m)
    turning += noise.g_rad_per_sqrt_rad**2 * abs(turn_rad)
    turning += config.standing_rad_per_sqrt_s**2 * dt_s
    Q = np.diag(walk * dt_s)
    Q[:3, :3] = (G * (factor * along, factor * turning)) @ G.T
    Q[S.WANDER, S.WANDER] = config.wander_sigma_rad**2 * (1.0 - kept**2)
    return Prediction(after, F, Q, distance_m, turn_rad)
