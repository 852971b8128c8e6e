"""Noises that are learned while a Kalman filter runs: of a sensor, and of the motion.

Of a sensor: Särkkä and Nummenmaa: Recursive noise adaptive Kalman filtering by variational Bayesian
approximations, IEEE Trans. Automatic Control 54(3), 2009. The variance of a sensor is unknown with
an inverse-gamma belief (a, b); each residual after the update, with what the state leaves
uncertain of it, counts as half an observation. Old ones fade.

Of the motion: by the likelihood of the innovations (Mehra: On the identification of variances and
adaptive Kalman filtering, IEEE Trans. Automatic Control 15(2), 1970, who compares methods). Its
derivative by the logarithm of a factor on the motion's noise is known in closed form, so is its
mean curvature, and each innovation makes one step of Fisher's scoring.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]

_MOST = 4.0


class AdaptiveVariance:
    """Factor on the variance that was guessed for a sensor.

    Parameters
    ----------
    guess_count
        How many measurements the guess, 1, counts for, > 0.
    half_life_s
        After which time what was seen counts half [s], > 0.
    """

    def __init__(self, guess_count: float, half_life_s: float) -> None:
        self._guess = 0.5 * guess_count
        self._half_life_s = half_life_s
        self._count = 0.0
        self._sum = 0.0

    @property
    def factor(self) -> float:
        """The factor: 1 before anything was measured."""
        return (self._guess + self._sum) / (self._guess + self._count)

    def fade(self, dt_s: float) -> None:
        """Let a time pass [s]."""
        kept = 0.5 ** (dt_s / self._half_life_s)
        self._count *= kept
        self._sum *= kept

    def add(self, normalised_square: float) -> None:
        """Take in a squared residual with the state's share, over the guessed variance.

        No single one counts for more than `_MOST` of the variance that is believed: outliers are
        no noise.
        """
        square = min(normalised_square, _MOST * self.factor)
        self._count += 0.5
        self._sum += 0.5 * square


class MotionNoiseFactor:
    """Factor on the variance that was guessed for the motion.

    Parameters
    ----------
    guess_sigma
        Standard deviation of the factor's logarithm before anything is seen, > 0.
    half_life_s
        After which time what was seen counts half [s], > 0.
    """

    def __init__(self, guess_sigma: float, half_life_s: float) -> None:
        self._guess = 1.0 / guess_sigma**2
        self._half_life_s = half_life_s
        self._information = 0.0
        self._log = 0.0

    @property
    def factor(self) -> float:
        """The factor: 1 before anything was measured."""
        return math.exp(self._log)

    def fade(self, dt_s: float) -> None:
        """Let a time pass [s]."""
        self._information *= 0.5 ** (dt_s / self._half_life_s)

    def add(self, innovation: Array, S: Array, by_motion: Array) -> None:
        """Take in an innovation (m,).

        Parameters
        ----------
        innovation
            Measured minus expected; outliers cut short.
        S
            Its covariance, (m, m).
        by_motion
            The part of S that comes of the motion's noise since the last measurement, (m, m).
        """
        share = np.linalg.solve(S, by_motion)
        half = np.linalg.solve(S, innovation)
        slope = 0.5 * float(half @ by_motion @ half - np.trace(share))
        self._information += 0.5 * float(np.sum(share * share.T))
        self._log += slope / (self._guess + self._information)
