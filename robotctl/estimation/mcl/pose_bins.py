"""Bins of poses in x, y and heading: how many are occupied, and which of them hang together.

Bins are kept in a hash table, so that their number is bounded by that of the poses, however large
the map. The heading's bins close to a circle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import borrows, compiled

_EMPTY = -1
_HALF = 1 << 23
"""Half the number of bins per axis that a key can hold."""


@dataclass(frozen=True, slots=True)
class BinSize:
    """Size of a bin.

    Parameters
    ----------
    side_m
        Side of its square [m], > 0.
    headings
        Bins of a full turn, >= 1.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    side_m: float = 0.25
    headings: int = 36

    def __post_init__(self) -> None:
        if not 0.0 < self.side_m < math.inf:
            raise ValueError(f"side_m must be finite and > 0, found {self.side_m}")
        if not 1 <= self.headings < 1 << 14:
            raise ValueError(f"headings must be in [1, 16384), found {self.headings}")


def kld_bound(bins: int, error: float, quantile: float) -> int:
    """Return how many particles keep the error of a belief over `bins` bins small.

    With them the Kullback-Leibler divergence between the particles' histogram and the true
    distribution is below `error` with the probability whose standard normal quantile is `quantile`
    (Fox 2003, "Adapting the sample size in particle filters through KLD-sampling", eq. 7, by the
    chi-square approximation of Wilson and Hilferty).

    Parameters
    ----------
    bins
        Occupied bins k; with one the bound is 1.
    error
        Greatest divergence [nat], > 0.
    quantile
        Quantile of the standard normal distribution; 2.33 for 99 %.
    """
    return math.ceil(_bound(bins, error, quantile))


@compiled
def _bound(bins: int, error: float, quantile: float) -> float:
    if bins < 2:
        return 1.0
    k = bins - 1.0
    # Wilson-Hilferty approximation of the chi-squared quantile (Fox 2003, KLD sampling).
    a = 2.0 / (9.0 * k)
    return k / (2.0 * error) * (1.0 - a + math.sqrt(a) * quantile) ** 3


def kld_size(
    poses: NDArray[np.float64],
    weights: NDArray[np.float64],
    size: BinSize,
    error: float,
    quantile: float,
    least: int,
    most: int,
    rng: np.random.Generator,
) -> int:
    """Return how many particles to draw from a belief: KLD sampling, in [`least`, `most`].

    Particles are drawn until there are as many as `kld_bound` asks for the bins that they occupy.
    The draws follow a golden-ratio sequence over the cumulated weights: each beginning of it is
    spread evenly, so the number varies little from draw to draw.

    Parameters
    ----------
    poses, weights
        The belief, (n, 3) and (n,).
    size, error, quantile
        Bins, and what `kld_bound` needs.
    least, most
        Bounds of the result, 1 <= least <= most. The first few draws know only one or two bins
        and would be content, so `least` is some tens or more.
    rng
        Gives the start of the sequence.
    """
    cumulated = np.cumsum(weights)
    table = _table(min(most, len(poses)))
    return int(
        _draw_until(
            poses,
            cumulated,
            size.side_m,
            size.headings,
            table,
            error,
            quantile,
            least,
            most,
            rng.random(),
        )
    )


def connected_bins(poses: NDArray[np.float64], size: BinSize) -> NDArray[np.int64]:
    """Return for each pose the number of its cluster, (n,), from 0 on in order of first poses.

    Two poses are in one cluster if a chain of occupied bins leads from one to the other, each the
    neighbour of the next by a side, an edge or a corner.
    """
    labels = np.empty(len(poses), np.int64)
    bins = np.empty(len(poses), np.int64)
    table = _table(len(poses))
    _label(poses, size.side_m, size.headings, table, np.empty(len(table), np.int64), bins, labels)
    return labels


def _table(entries: int) -> NDArray[np.int64]:
    """Return an empty hash table that is at most half full with `entries`."""
    return np.full(1 << (2 * max(entries, 1) - 1).bit_length(), _EMPTY, np.int64)


@compiled
def _key(column: int, row: int, heading: int) -> int:
    """Return one number for a bin."""
    return (((column + _HALF) & 0xFFFFFF) << 38) | (((row + _HALF) & 0xFFFFFF) << 14) | heading


@compiled
@borrows
def _bin_key(pose: NDArray[np.float64], side: float, headings: int) -> int:
    turns = pose[2] / (2.0 * math.pi)
    heading = min(int((turns - math.floor(turns)) * headings), headings - 1)
    return _key(math.floor(pose[0] / side), math.floor(pose[1] / side), heading)


@compiled
@borrows
def _slot(table: NDArray[np.int64], key: int) -> int:
    """Return the index of a key in the table, or its empty slot."""
    mask = len(table) - 1
    # Mixes high bits into low ones; without a wrap-around that numba would promote to float.
    mixed = key ^ (key >> 14) ^ (key >> 38)
    mixed ^= (mixed << 7) ^ (mixed >> 9) ^ (key >> 27)
    place = mixed & mask
    while table[place] != _EMPTY and table[place] != key:
        place = (place + 1) & mask
    return place


@compiled
def _draw_until(
    poses: NDArray[np.float64],
    cumulated: NDArray[np.float64],
    side: float,
    headings: int,
    table: NDArray[np.int64],
    error: float,
    quantile: float,
    least: int,
    most: int,
    start: float,
) -> int:
    """Return the number of draws after which the bound is met."""
    golden = 0.6180339887498949
    total = cumulated[-1]
    bins, drawn, needed = 0, 0, 1.0
    at = start
    while drawn < most and (drawn < least or drawn < needed):
        i = min(np.searchsorted(cumulated, at * total, side="right"), len(poses) - 1)
        key = _bin_key(poses[i], side, headings)
        place = _slot(table, key)
        if table[place] == _EMPTY:
            table[place] = key
            bins += 1
            needed = _bound(bins, error, quantile)
        drawn += 1
        at += golden
        at -= math.floor(at)
    return drawn


@compiled
@borrows
def _root(parents: NDArray[np.int64], i: int) -> int:
    while parents[i] != i:
        parents[i] = parents[parents[i]]
        i = parents[i]
    return i


@compiled
def _label(
    poses: NDArray[np.float64],
    side: float,
    headings: int,
    table: NDArray[np.int64],
    numbers: NDArray[np.int64],
    bins: NDArray[np.int64],
    labels: NDArray[np.int64],
) -> None:
    """Fill `labels`: number the bins, join neighbours, number the trees that result."""
    n = len(poses)
    firsts = np.empty(n, np.int64)
    count = 0
    for i in range(n):
        key = _bin_key(poses[i], side, headings)
        place = _slot(table, key)
        if table[place] == _EMPTY:
            table[place] = key
            numbers[place] = count
            firsts[count] = i
            count += 1
        bins[i] = numbers[place]
    parents = np.arange(count)
    for b in range(count):
        _join_neighbours(poses[firsts[b]], b, side, headings, table, numbers, parents)
    clusters = 0
    names = np.full(count, -1, np.int64)
    for i in range(n):
        root = _root(parents, bins[i])
        if names[root] < 0:
            names[root] = clusters
            clusters += 1
        labels[i] = names[root]


@compiled
@borrows
def _join_neighbours(
    pose: NDArray[np.float64],
    b: int,
    side: float,
    headings: int,
    table: NDArray[np.int64],
    numbers: NDArray[np.int64],
    parents: NDArray[np.int64],
) -> None:
    """Join bin `b` with the occupied ones about it; half of the 26 suffice, each pair has one."""
    heading = _bin_key(pose, side, headings) & 0x3FFF
    column, row = math.floor(pose[0] / side), math.floor(pose[1] / side)
    for step in range(14, 27):
        other = _key(
            column + step // 9 - 1,
            row + step // 3 % 3 - 1,
            (heading + step % 3 - 1 + headings) % headings,
        )
        place = _slot(table, other)
        if table[place] != _EMPTY:
            parents[_root(parents, b)] = _root(parents, numbers[place])
