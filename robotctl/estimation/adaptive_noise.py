"""The noise of a sensor, learned from its residuals while a Kalman filter runs.

Source: Särkkä and Nummenmaa: Recursive noise adaptive Kalman filtering by variational Bayesian
approximations, IEEE Trans. Automatic Control 54(3), 2009. The variance of a sensor is unknown with
an inverse-gamma belief (a, b); each residual after the update, with what the state leaves
uncertain of it, counts as half an observation. Old ones fade.
"""

from __future__ import annotations

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
