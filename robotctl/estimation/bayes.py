"""Bayesian inference in its smallest pieces: places with probabilities, Gaussians, likelihoods.

Source: Thrun, Burgard, Fox: Probabilistic Robotics, sections 2.4, 4.1.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array: TypeAlias = NDArray[np.float64]


class DiscreteBayes:
    """Belief over a finite number of states: the discrete Bayes filter.

    It assumes that the state holds all that the next one and a measurement depend on (Markov), and
    that the true state is among them.

    Parameters
    ----------
    prior
        Probability of each state, (n,), >= 0; scaled to a sum of 1.

    Raises
    ------
    ValueError
        If the prior is not (n,) and finite, or has a negative value or no positive one.
    """

    def __init__(self, prior: ArrayLike) -> None:
        values = np.asarray(prior, dtype=np.float64)
        if values.ndim != 1 or not np.all(np.isfinite(values)) or np.any(values < 0.0):
            raise ValueError(
                f"prior must be (n,), finite and not negative, found {values.tolist()}"
            )
        if not np.sum(values) > 0.0:
            raise ValueError("prior must be positive somewhere, found 0 everywhere")
        self._belief = values / np.sum(values)

    @property
    def belief(self) -> Array:
        """Probability of each state, (n,), with a sum of 1."""
        return self._belief.copy()

    def predict(self, transition: Array) -> Array:
        """Move: sum over j of p(i | j, motion) bel(j), the theorem of total probability.

        Parameters
        ----------
        transition
            (n, n), its column j: where state j goes with which probability; columns sum to 1.

        Raises
        ------
        ValueError
            If it is invalid.
        """
        n = len(self._belief)
        columns = transition.sum(axis=0) if transition.shape == (n, n) else np.zeros(1)
        if np.any(transition < 0.0) or not np.allclose(columns, 1.0, rtol=0.0, atol=1e-9):
            raise ValueError(f"transition must be ({n}, {n}) with columns that sum to 1")
        self._belief = transition @ self._belief
        return self.belief

    def update(self, likelihood: ArrayLike) -> float:
        """Measure: Bayes' rule, bel(i) = p(z | i) bel(i) / p(z).

        Parameters
        ----------
        likelihood
            p(z | i) of the measurement in each state, (n,), >= 0, on any scale.

        Returns
        -------
        p(z) on that scale: how well the measurement was expected.

        Raises
        ------
        ValueError
            If it is invalid, or excludes every possible state.
        """
        values = np.asarray(likelihood, dtype=np.float64)
        if values.shape != self._belief.shape or not np.all(values >= 0.0):
            raise ValueError(
                f"likelihood must be {self._belief.shape} and not negative, found {values.tolist()}"
            )
        joint = values * self._belief
        evidence = float(np.sum(joint))
        if not 0.0 < evidence < math.inf:
            raise ValueError("the measurement is impossible in every state that is believed in")
        self._belief = joint / evidence
        return evidence


def shift_transition(n: int, steps: int, moves: ArrayLike, circular: bool = False) -> Array:
    """Return the transition of a motion along n cells, for `DiscreteBayes.predict`, (n, n).

    Parameters
    ----------
    n
        Cells.
    steps
        Cells that the motion should cover; negative is backwards.
    moves
        (2 k + 1,): probability of covering k less, ..., as many, ..., k more; sum 1.
    circular
        Whether the last cell is followed by the first; otherwise the ends are walls.

    Raises
    ------
    ValueError
        If the number of moves is even, or they do not sum to 1.
    """
    chances = np.asarray(moves, dtype=np.float64)
    if chances.ndim != 1 or len(chances) % 2 == 0 or not math.isclose(float(chances.sum()), 1.0):
        raise ValueError(f"moves must be an odd number of chances with sum 1, found {chances}")
    offsets = steps + np.arange(len(chances)) - len(chances) // 2
    begin = np.arange(n)[None, :]
    end = begin + offsets[:, None]
    end = end % n if circular else np.clip(end, 0, n - 1)
    transition = np.zeros((n, n))
    np.add.at(transition, (end, np.broadcast_to(begin, end.shape)), chances[:, None])
    return transition


@dataclass(frozen=True, slots=True)
class Gaussian:
    """A normal distribution of one quantity.

    Parameters
    ----------
    mean
        In the quantity's unit.
    variance
        In its square, > 0.

    Raises
    ------
    ValueError
        If the mean is not finite or the variance not positive.
    """

    mean: float
    variance: float

    def __post_init__(self) -> None:
        if not math.isfinite(self.mean) or not 0.0 < self.variance < math.inf:
            raise ValueError(f"mean must be finite and variance > 0, found {self}")

    @property
    def sigma(self) -> float:
        """Standard deviation."""
        return math.sqrt(self.variance)

    def __mul__(self, other: Gaussian) -> Gaussian:
        """Return the product, scaled to a density: what two independent sources say together."""
        total = self.variance + other.variance
        return Gaussian(
            (self.mean * other.variance + other.mean * self.variance) / total,
            self.variance * other.variance / total,
        )

    def __add__(self, other: Gaussian) -> Gaussian:
        """Return the distribution of the sum of two independent quantities: a motion added."""
        return Gaussian(self.mean + other.mean, self.variance + other.variance)


def fuse(sources: Iterable[Gaussian]) -> Gaussian:
    """Return what independent sources say together of one quantity: inverse variances add.

    Raises
    ------
    ValueError
        If there is no source.
    """
    information, weighted = 0.0, 0.0
    for source in sources:
        information += 1.0 / source.variance
        weighted += source.mean / source.variance
    if information == 0.0:
        raise ValueError("nothing to fuse")
    return Gaussian(weighted / information, 1.0 / information)


def gaussian_likelihood(z: ArrayLike, expected: ArrayLike, sigma: float) -> Array:
    """Return the density of measurements about what was expected, with sigma in the same unit."""
    off = (np.asarray(z, np.float64) - np.asarray(expected, np.float64)) / sigma
    return np.asarray(np.exp(-0.5 * off**2) / (sigma * math.sqrt(math.tau)))


def robust_likelihood(z: ArrayLike, expected: ArrayLike, sigma: float, k: float) -> Array:
    """Return exp(-(z - m)^2 / (2 sigma^2)) + K: heavy tails, so no measurement rules a state out.

    On a scale of its own, 1 + K at most.

    Parameters
    ----------
    z, expected
        Measured z and expected m, in one unit.
    sigma
        Standard deviation, in the same, > 0.
    k
        Chance of a wild measurement against a good one, >= 0.
    """
    off = (np.asarray(z, np.float64) - np.asarray(expected, np.float64)) / sigma
    return np.asarray(np.exp(-0.5 * off**2) + k)
