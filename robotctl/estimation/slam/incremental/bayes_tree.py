"""The Bayes tree: a Cholesky factor that is renewed where new factors reach.

A clique is a front of the factor: variables that are eliminated together, and those that they meet
later. New factors change only the cliques from their variables up to the root. These are taken
apart and eliminated anew, in a new order; the subtrees below hang their last updates, kept with
them, to the new cliques. Kaess, Johannsson, Roberts, Ila, Leonard and Dellaert, iSAM2: incremental
smoothing and mapping using the Bayes tree, IJRR 31 (2012).

The gradient is one more row below all columns, so that it is eliminated with them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


_WASTE = 100_000
"""Numbers in the pool up to which gaps of cliques that are gone stay."""
_AHEAD = 2**18
"""Numbers at most by which the pool is longer than it has to be."""


class Cliques(NamedTuple):
    """The cliques of a tree.

    Where it was renewed, children have smaller numbers than their parents; what was hung to it
    since then has larger ones, again larger than those of its parents.

    Parameters
    ----------
    parents
        -1: the root, -2: the clique is gone.
    columns, rows
        Of each front; the last row is the gradient.
    row_starts, panel_starts, update_starts
        Where the rows, the columns of the factor and the update to the parent begin.
    row_pool
        Columns of the whole system that the rows of the fronts are; -1 for the gradient.
    pool
        Numbers of factors, each before its update: the lower triangle, by columns.
    used
        Cliques, entries of `row_pool` and of `pool` in use; cliques when the tree was renewed last.
    """

    parents: Ints
    columns: Ints
    rows: Ints
    row_starts: Ints
    panel_starts: Ints
    update_starts: Ints
    row_pool: Ints
    pool: Floats
    used: Ints


class Links(NamedTuple):
    """The variables and the linearised factors of a graph.

    Parameters
    ----------
    offsets, dof
        First column and width of each variable.
    owner
        The variable of each column.
    begins, ends
        First entry of each factor, and the free variable of each entry; entries of a factor follow
        each other.
    factor_of
        The factor of each entry.
    places
        Where each factor's matrix (columns one after the other) and gradient begin in `terms`.
    terms
        Their numbers.
    heads, following
        The entries of each variable as linked lists.
    """

    offsets: Ints
    dof: Ints
    owner: Ints
    begins: Ints
    ends: Ints
    factor_of: Ints
    places: Ints
    terms: Floats
    heads: Ints
    following: Ints


@compiled
def grown_ints(values: Ints, used: int, need: int) -> Ints:
    """Return an array that has room for `need` more."""
    if used + need <= len(values):
        return values
    larger = np.empty(2 * (used + need), np.int64)
    for i in range(used):
        larger[i] = values[i]
    return larger


def with_room(cliques: Cliques, need: int) -> Floats:
    """Return `pool`, lengthened where it stands: no second one is beside it while it grows."""
    if need > len(cliques.pool):
        cliques.pool.resize(need + min(need // 8, _AHEAD), refcheck=False)
    return cliques.pool


@compiled
def columns_of(offsets: Ints, dof: Ints, variables: Ints) -> Ints:
    """Return the columns of some variables, one after the other."""
    total = 0
    for v in variables:
        total += dof[v]
    result, at = np.empty(total, np.int64), 0
    for v in variables:
        for k in range(dof[v]):
            result[at] = offsets[v] + k
            at += 1
    return result


@compiled
def packed(size: int) -> int:
    """Return how many numbers the triangle of an update takes."""
    return size * (size + 1) // 2


@compiled
def live(cliques: Cliques) -> int:
    """Return the numbers in `pool` of all cliques that are there."""
    total = 0
    for c in range(cliques.used[0]):
        if cliques.parents[c] != -2:
            rows, columns = cliques.rows[c], cliques.columns[c]
            total += rows * columns + packed(rows - columns)
    return total


@compiled
def compact(  # noqa: C901 - one compiled loop
    cliques: Cliques, clique_of: Ints, named: Ints, most: int
) -> None:
    """Close gaps of cliques that are gone, in place, and renumber the others, those `named` too.

    Cliques behind the first `most` numbers of the pool that are moved stay where they are.
    """
    used = cliques.used
    renamed = np.full(used[0], -1, np.int64)
    k, row_at, at, moved, renewed = 0, 0, 0, 0, 0
    for c in range(used[0]):
        up, rows, columns = cliques.parents[c], cliques.rows[c], cliques.columns[c]
        if up == -2:
            continue
        renamed[c] = k
        row_begin, begin = cliques.row_starts[c], cliques.panel_starts[c]
        need = rows * columns + packed(rows - columns)
        if row_at < row_begin:
            for i in range(rows):
                cliques.row_pool[row_at + i] = cliques.row_pool[row_begin + i]
        if moved >= most:
            at = begin
        if at < begin:
            there, here = cliques.pool[at : at + need], cliques.pool[begin : begin + need]
            for i in range(need):
                there[i] = here[i]
            moved += need
        cliques.parents[k], cliques.columns[k], cliques.rows[k] = up, columns, rows
        cliques.row_starts[k], cliques.panel_starts[k] = row_at, at
        cliques.update_starts[k] = at + rows * columns
        row_at += rows
        at += need
        k += 1
        if c < used[3]:
            renewed = k
    for c in range(k):
        if cliques.parents[c] >= 0:
            cliques.parents[c] = renamed[cliques.parents[c]]
    for v in range(len(clique_of)):
        if clique_of[v] >= 0:
            clique_of[v] = renamed[clique_of[v]]
    for i in range(len(named)):
        named[i] = renamed[named[i]]
    used[0], used[1], used[2], used[3] = k, row_at, at, renewed


@compiled
def tidy(cliques: Cliques, clique_of: Ints, named: Ints, share: int, most: int) -> None:
    """Close gaps where more than one number in `share` is of cliques that are gone.

    The rest is as of `compact`; small pools keep their gaps.
    """
    if cliques.used[2] > _WASTE and share * (cliques.used[2] - live(cliques)) > cliques.used[2]:
        compact(cliques, clique_of, named, most)
