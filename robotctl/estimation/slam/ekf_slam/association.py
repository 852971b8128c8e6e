"""Which feature is it that was measured: nearest neighbour, and joint compatibility.

A measurement and a feature are compatible if the squared innovation, normalised by its covariance,
lies inside a chi-squared gate. Nearest neighbour takes the nearest compatible pairs first, each
feature and each measurement once. Joint compatibility branch and bound (Neira and Tardós: Data
association in stochastic mapping using the joint compatibility test, IEEE Trans. Robotics and
Automation 17(6), 2001) takes the largest set of pairs whose innovations fit together, with the
correlations that a common pose error gives them; of sets alike large, the one that fits best.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.estimation.kalman.chi_squared import chi2_quantile

Array: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.int64]

NONE: Final = -1
_MOST_NODES: Final = 20_000
"""Maximum nodes of a search; one that would need more returns the best so far."""


@dataclass(frozen=True, slots=True)
class Gates:
    """Limits of compatibility, as probabilities that a right pair lies inside.

    Parameters
    ----------
    compatible
        Of a pair, and of a set of pairs jointly, in (0, 1).
    new
        A measurement outside of this of every feature is of a new one, in [compatible, 1).
    ratio
        A jointly compatible pair counts if it is so many times as likely as that with any feature
        which is not paired otherwise, >= 1: a wrong pair spoils the map, a missing one costs
        little.

    Raises
    ------
    ValueError
        If a number is out of its range.
    """

    compatible: float = 0.95
    new: float = 0.999
    ratio: float = 20.0

    def __post_init__(self) -> None:
        if not 0.0 < self.compatible <= self.new < 1.0:
            raise ValueError(
                f"gates must be 0 < compatible <= new < 1, found {self.compatible} and {self.new}"
            )
        if not self.ratio >= 1.0:
            raise ValueError(f"ratio: {self.ratio} found, a number >= 1 allowed")


def pair_nis(innovations: Array, G: Array, R: Array) -> Array:
    """Return the normalised squared innovation of each pair, (m, k).

    Parameters
    ----------
    innovations
        Of m measurements from k features, (m, k, 2).
    G
        H P H' of each feature, (k, 2, 2).
    R
        Noises of the measurements, (m, 2, 2).
    """
    S = R[:, np.newaxis] + G
    determinant = S[..., 0, 0] * S[..., 1, 1] - S[..., 0, 1] * S[..., 1, 0]
    u, v = innovations[..., 0], innovations[..., 1]
    square = S[..., 1, 1] * u * u - (S[..., 0, 1] + S[..., 1, 0]) * u * v + S[..., 0, 0] * v * v
    found: Array = square / determinant
    return found


def unambiguous(found: Indices, nis: Array, G: Array, R: Array, ratio: float) -> Indices:
    """Return the features of measurements (m,), `NONE` for those that may as well be of another.

    Parameters
    ----------
    found
        The feature of each measurement.
    nis, G, R
        Of each pair, (m, k), and as of `pair_nis`.
    ratio
        See `Gates`.
    """
    S = R[:, np.newaxis] + G
    cost = nis + np.log(S[..., 0, 0] * S[..., 1, 1] - S[..., 0, 1] * S[..., 1, 0])
    paired = found[found >= 0]
    others = cost.copy()
    others[:, paired] = np.inf
    rows = np.flatnonzero(found >= 0)
    apart = others[rows].min(axis=1) - cost[rows, found[rows]]  # -2 log of likelihoods
    result = found.copy()
    result[rows[apart < 2.0 * np.log(ratio)]] = NONE
    return result


def nearest_neighbour(nis: Array, gate: float) -> Indices:
    """Return the feature of each measurement, (m,), `NONE` where none is compatible.

    Parameters
    ----------
    nis
        Of each pair, (m, k).
    gate
        Most that it may be.
    """
    found = np.full(len(nis), NONE)
    taken: set[int] = set()
    for at in np.argsort(nis, axis=None, kind="stable").tolist():
        a, i = divmod(at, nis.shape[1])
        if nis[a, i] > gate:
            break
        if found[a] == NONE and i not in taken:
            found[a] = i
            taken.add(i)
    return found


def joint_compatibility(
    innovations: Array, G: Array, R: Array, nis: Array, probability: float
) -> Indices:
    """Return the feature of each measurement, (m,), `NONE` for those that are of none.

    Parameters
    ----------
    innovations, R
        As of `pair_nis`.
    G
        H P H' of all features together, (2 k, 2 k).
    nis
        Of each pair, (m, k).
    probability
        Of the gate of a pair, and of a set.
    """
    m = len(nis)
    gates = np.array([0.0] + [chi2_quantile(probability, 2.0 * (a + 1)) for a in range(m)])
    if m == 0 or nis.shape[1] == 0:
        return np.full(m, NONE)
    order = np.argsort(nis, axis=1, kind="stable")
    found: Indices = _branch_and_bound(innovations, G, R, nis, order, gates, _MOST_NODES)
    return found


@compiled
def _extend(
    L: Array, y: Array, p: int, measured: Indices, feature: Indices, innovations: Array, G: Array,
    R: Array,
) -> float:  # fmt: skip
    """Add the two rows of pair p to the factor L of a set, and to y; return the distance of it.

    Parameters
    ----------
    L, y
        Cholesky factor of the joint innovation covariance, and L^-1 times the innovations.
    measured, feature
        Measurement and feature of each pair, up to p.
    innovations, G, R
        As of `joint_compatibility`.
    """
    a, i = measured[p], feature[p]
    total = 0.0
    for r in range(2):
        row = 2 * p + r
        left = innovations[a, i, r]
        for column in range(row + 1):
            q, c = column // 2, column % 2
            value = G[2 * i + r, 2 * feature[q] + c]
            if q == p:
                value += R[a, r, c]
            for z in range(column):
                value -= L[row, z] * L[column, z]
            if column == row:
                L[row, row] = math.sqrt(value)
            else:
                L[row, column] = value / L[column, column]
                left -= L[row, column] * y[column]
        y[row] = left / L[row, row]
        total += y[row] * y[row]
    return total


@compiled
def _branch_and_bound(
    innovations: Array, G: Array, R: Array, nis: Array, order: Indices, gates: Array, most: int
) -> Indices:
    """Search the tree whose level a says of which feature measurement a is.

    The Cholesky factor of the joint innovation covariance grows and shrinks with the branch: a pair
    more is two rows more, and the joint distance is a sum of squares that only grows.
    """
    m, k = nis.shape
    best = np.full(m, -1)
    best_pairs, best_distance = 0, np.inf
    chosen = np.full(m, -1)
    tried = np.zeros(m, np.int64)
    pairs = np.zeros(m + 1, np.int64)
    distance = np.zeros(m + 1)
    L, y = np.zeros((2 * m, 2 * m)), np.zeros(2 * m)
    measured, feature = np.zeros(m, np.int64), np.zeros(m, np.int64)
    taken = np.zeros(k, np.bool_)
    a, nodes = 0, 0
    while a >= 0:
        if a == m:
            if pairs[a] > best_pairs or (pairs[a] == best_pairs and distance[a] < best_distance):
                best[:] = chosen
                best_pairs, best_distance = pairs[a], distance[a]
            a -= 1
            continue
        if chosen[a] >= 0:
            taken[chosen[a]] = False
            chosen[a] = -1
        at = tried[a]
        could = pairs[a] + m - a
        worse = could < best_pairs or (could == best_pairs and distance[a] >= best_distance)
        nodes += 1
        if at > k or worse or nodes > most:
            tried[a] = 0
            a -= 1
            continue
        tried[a] += 1
        if at == k or nis[a, order[a, at]] > gates[1]:
            tried[a] = k + 1  # those behind it fit less: none is the last choice
            pairs[a + 1], distance[a + 1] = pairs[a], distance[a]
            a += 1
            continue
        i = order[a, at]
        if taken[i]:
            continue
        p = pairs[a]
        measured[p], feature[p] = a, i
        total = distance[a] + _extend(L, y, p, measured, feature, innovations, G, R)
        if total <= gates[p + 1]:
            chosen[a] = i
            taken[i] = True
            pairs[a + 1], distance[a + 1] = p + 1, total
            a += 1
    return best
