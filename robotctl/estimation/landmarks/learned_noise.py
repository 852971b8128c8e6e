"""Noises of sightings and of the motion between them, learned while a filter runs."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.kalman.adaptive_noise import AdaptiveVariance, MotionNoiseFactor
from robotctl.estimation.landmarks.config import LandmarkConfig

Array: TypeAlias = NDArray[np.float64]


class LearnedNoise:
    """Factors on the configured noises of ranges, bearings and motion.

    Parameters
    ----------
    config
        First guesses.
    states
        Size of the robot's state.
    """

    def __init__(self, config: LandmarkConfig, states: int) -> None:
        self._config = config
        self._variances = tuple(
            AdaptiveVariance(config.guess_sightings, config.forgetting_s) for _ in range(2)
        )
        self._motion = MotionNoiseFactor(config.motion_guess_sigma, config.forgetting_s)
        self._since = np.zeros((states, states))  # what the motion's noise added since a sighting

    @property
    def sighting_factors(self) -> Array:
        """Factors on the variances of range and bearing, (2,)."""
        return np.array([variance.factor for variance in self._variances])

    @property
    def motion_factor(self) -> float:
        """Standard deviations that the motion is taken to have, over the configured ones, >= 1.

        What is learned between sightings close to each other misses that errors of the motion last,
        and so add up faster than white noise where nothing is seen. So it counts `correlation`
        times, and never for less than the guess.
        """
        return math.sqrt(max(1.0, self._config.correlation * self._motion.factor))

    def moved(self, F: Array, Q: Array, dt_s: float) -> None:
        """Take in a motion: its Jacobian and noise, (n, n), and how long it took [s]."""
        self._since = F @ self._since @ F.T
        self._since[:3, :3] += Q[:3, :3]
        self._motion.fade(dt_s)
        for variance in self._variances:
            variance.fade(dt_s)

    def guess(self, distances_m: Array) -> Array:
        """Return the configured standard deviations of range and bearing, (m, 2)."""
        c = self._config
        sigma = np.empty((len(distances_m), 2))
        sigma[:, 0] = c.sighting_range_sigma_m + c.sighting_range_sigma_m_per_m * distances_m
        sigma[:, 1] = c.sighting_bearing_sigma_rad
        return sigma

    def of_sightings(self, distances_m: Array) -> Array:
        """Return the noises of sightings at distances (m,), as learned, (m, 2, 2)."""
        variances = self.guess(distances_m) ** 2 * self.sighting_factors * self._config.correlation
        return np.eye(2) * variances[:, np.newaxis]

    def learn_sightings(self, residuals: Array, covariances: Array, sigma: Array) -> None:
        """Learn the noise of sightings from the residuals after an update.

        Parameters
        ----------
        residuals, covariances
            Measured minus expected (m, 2), and what the state leaves uncertain of it, (m, 2, 2).
        sigma
            Configured standard deviations, (m, 2).
        """
        # The state's share came by sightings whose noise was taken `correlation` times as large.
        uncertain = np.diagonal(covariances, axis1=1, axis2=2) / self._config.correlation
        squares = (residuals**2 + uncertain) / sigma**2
        for variance, column in zip(self._variances, squares.T.tolist(), strict=True):
            for square in column:
                variance.add(square)

    def learn_motion(self, innovations: Array, H: Array, G: Array, R: Array) -> None:
        """Learn the noise of the motion since the last sighting.

        Parameters
        ----------
        innovations
            Measured minus expected before the update, outliers cut short, (m, 2).
        H
            Jacobians of the expectations by the robot's state, (m, 2, n).
        G, R
            Covariances of the innovations by the state, and of the sightings, (m, 2, 2).
        """
        share = self._motion.factor / self.motion_factor**2
        for off, by_robot, whole, noise in zip(innovations, H, G, R, strict=True):
            taken = by_robot @ self._since @ by_robot.T
            learned = share * taken
            S = whole + noise / self._config.correlation - taken + learned
            self._motion.add(off, S, learned)
        self._since[:] = 0.0
