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

from robotctl.compiled import compiled

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Cliques(NamedTuple):
    """The cliques of a tree; children have smaller numbers than their parents.

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
        Numbers of factors and updates.
    used
        Cliques, entries of `row_pool` and of `pool` in use.
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
    first, second
        Variables of each factor; -1: none.
    places
        Where each factor's matrix (columns one after the other) and gradient begin in `terms`.
    terms
        Their numbers.
    heads, following
        The factors of each variable as linked lists: entry 2 f + slot is factor f.
    """

    offsets: Ints
    dof: Ints
    owner: Ints
    first: Ints
    second: Ints
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


@compiled
def grown_floats(values: Floats, used: int, need: int) -> Floats:
    """Return an array that has room for `need` more."""
    if used + need <= len(values):
        return values
    larger = np.empty(2 * (used + need))
    for i in range(used):
        larger[i] = values[i]
    return larger


@compiled
def solve_down(  # noqa: C901 - one compiled loop
    cliques: Cliques, first: int, threshold: float, increments: Floats
) -> None:
    """Renew the increments from the root down, and end where they hardly change.

    Parameters
    ----------
    cliques
        The tree.
    first
        From this clique on all are solved.
    threshold
        An increment that changes by less is not passed on: the wildfire threshold.
    increments
        Of all columns; changed.
    """
    count = cliques.used[0]
    is_solved = np.zeros(count, np.bool_)
    is_moved = np.zeros(len(increments), np.bool_)
    work = np.empty(1)
    for c in range(count - 1, -1, -1):
        if cliques.parents[c] == -2:
            continue
        rows, columns, begin = cliques.rows[c], cliques.columns[c], cliques.row_starts[c]
        if c < first:
            if not is_solved[cliques.parents[c]]:
                continue
            is_reached = False
            for at in range(begin + columns, begin + rows - 1):
                if is_moved[cliques.row_pool[at]]:
                    is_reached = True
                    break
            if not is_reached:
                continue
        is_solved[c] = True
        if rows > len(work):
            work = np.empty(2 * rows)
        for i in range(columns, rows - 1):
            work[i] = increments[cliques.row_pool[begin + i]]
        panel = cliques.panel_starts[c]
        for j in range(columns - 1, -1, -1):
            column = panel + j * rows
            value = -cliques.pool[column + rows - 1]
            for i in range(j + 1, rows - 1):
                value -= cliques.pool[column + i] * work[i]
            work[j] = value / cliques.pool[column + j]
            at = cliques.row_pool[begin + j]
            if abs(work[j] - increments[at]) > threshold:
                is_moved[at] = True
            increments[at] = work[j]


@compiled
def compact(cliques: Cliques, clique_of: Ints) -> Cliques:
    """Return the tree without the cliques that are gone."""
    count = cliques.used[0]
    renamed = np.full(count, -1, np.int64)
    live, row_need, need = 0, 0, 0
    for c in range(count):
        if cliques.parents[c] != -2:
            renamed[c] = live
            live += 1
            behind = cliques.rows[c] - cliques.columns[c]
            row_need += cliques.rows[c]
            need += cliques.rows[c] * cliques.columns[c] + behind * behind
    parents, columns, rows = (
        np.empty(2 * live, np.int64),
        np.empty(2 * live, np.int64),
        np.empty(2 * live, np.int64),
    )
    row_starts, panel_starts, update_starts = (
        np.empty(2 * live, np.int64),
        np.empty(2 * live, np.int64),
        np.empty(2 * live, np.int64),
    )
    row_pool, pool = np.empty(2 * row_need, np.int64), np.empty(2 * need)
    row_at, at = 0, 0
    for c in range(count):
        k = renamed[c]
        if k < 0:
            continue
        up = cliques.parents[c]
        parents[k] = renamed[up] if up >= 0 else -1
        columns[k], rows[k] = cliques.columns[c], cliques.rows[c]
        row_starts[k], panel_starts[k] = row_at, at
        for i in range(rows[k]):
            row_pool[row_at + i] = cliques.row_pool[cliques.row_starts[c] + i]
        row_at += rows[k]
        for i in range(rows[k] * columns[k]):
            pool[at + i] = cliques.pool[cliques.panel_starts[c] + i]
        at += rows[k] * columns[k]
        update_starts[k] = at
        behind = rows[k] - columns[k]
        for i in range(behind * behind):
            pool[at + i] = cliques.pool[cliques.update_starts[c] + i]
        at += behind * behind
    for v in range(len(clique_of)):
        if clique_of[v] >= 0:
            clique_of[v] = renamed[clique_of[v]]
    used = np.array([live, row_at, at])
    return Cliques(
        parents, columns, rows, row_starts, panel_starts, update_starts, row_pool, pool, used
    )
