"""Equations solved with a Bayes tree: from the root down, and on the paths up to it.

With the factor L L^T of the information and a Jacobian J, the covariance of J x is Y^T Y with
L Y = J^T (Kaess, Dellaert, Covariance recovery from a square root information matrix for data
association, RAS 57, 2009).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.estimation.slam.incremental.bayes_tree import Cliques, Floats, Ints
from robotctl.estimation.slam.linear.cholesky import subtract_product

_LONG = 400
"""Rows beyond which BLAS multiplies faster than a loop."""
_AT_ONCE = 4
"""Columns that are subtracted together."""


@compiled
def paths_up(cliques: Cliques, clique_of: Ints, variables: Ints) -> NDArray[np.bool_]:
    """Return which cliques lie between the root and those of some variables, both with them."""
    is_on_path = np.zeros(cliques.used[0], np.bool_)
    for v in variables:
        c = clique_of[v]
        while c >= 0 and not is_on_path[c]:
            is_on_path[c] = True
            c = cliques.parents[c]
    return is_on_path


@compiled
def solve_down(  # noqa: C901 - one compiled loop
    cliques: Cliques, is_due: NDArray[np.bool_], shift: Floats, threshold: float, increments: Floats
) -> None:
    """Renew the increments from the root down, and end where they hardly change.

    Parameters
    ----------
    cliques
        The tree.
    is_due
        Cliques that are solved in any case; with each its parent.
    shift
        Added to the eliminated gradient of each column.
    threshold
        An increment that changes by less is not passed on: the wildfire threshold.
    increments
        Of all columns; changed.
    """
    count, renewed = cliques.used[0], cliques.used[3]
    is_solved = np.zeros(count, np.bool_)
    is_moved = np.zeros(len(increments), np.bool_)
    work = np.empty(1)
    for k in range(count):
        c = renewed - 1 - k if k < renewed else k
        if cliques.parents[c] == -2:
            continue
        rows, columns, begin = cliques.rows[c], cliques.columns[c], cliques.row_starts[c]
        if not is_due[c]:
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
            at = cliques.row_pool[begin + j]
            value = -cliques.pool[column + rows - 1] - shift[at]
            if rows > _LONG:
                value -= np.dot(
                    cliques.pool[column + j + 1 : column + rows - 1], work[j + 1 : rows - 1]
                )
            else:
                for i in range(j + 1, rows - 1):
                    value -= cliques.pool[column + i] * work[i]
            work[j] = value / cliques.pool[column + j]
            if abs(work[j] - increments[at]) > threshold:
                is_moved[at] = True
            increments[at] = work[j]


@compiled
def _subtract_columns(target: Floats, pool: Floats, last: int, rows: int, y: Floats) -> None:
    """Subtract columns times `y` (up to `_AT_ONCE`,) from what lies below them, in their order.

    The part of the last column begins at `last`, those before it `rows` numbers earlier each.
    """
    n = len(target)
    if len(y) == _AT_ONCE:
        a, b = (
            pool[last - 3 * rows : last - 3 * rows + n],
            pool[last - 2 * rows : last - 2 * rows + n],
        )
        c, d = pool[last - rows : last - rows + n], pool[last : last + n]
        p, q, r, s = y[0], y[1], y[2], y[3]
        for i in range(n):
            target[i] = target[i] - a[i] * p - b[i] * q - c[i] * r - d[i] * s
        return
    for k in range(len(y)):
        begin = last - (len(y) - 1 - k) * rows
        subtract_product(target, pool[begin : begin + n], y[k])


@compiled
def sweep_up(  # noqa: C901 - one compiled loop
    cliques: Cliques, clique_of: Ints, variables: Ints, columns: Ints, right: Floats, size: int
) -> tuple[Ints, Floats, Floats]:
    """Solve L Y = B, where only paths from some variables to the root have anything to solve.

    Elimination only passes on what it finds to the root.

    Parameters
    ----------
    cliques, clique_of
        The tree, and the clique in which each variable is eliminated.
    variables
        Whose columns are meant; only free ones, that are in the tree.
    columns, right
        Columns of the whole system (n,), and B over them, (m, n), transposed.
    size
        Columns of the whole system.

    Returns
    -------
    reached : ndarray, (k,)
        The columns on the paths.
    Y : ndarray, (k, m)
    gradient : ndarray, (k,)
        Eliminated as far.
    """
    m, count, renewed = len(right), cliques.used[0], cliques.used[3]
    is_on_path = paths_up(cliques, clique_of, variables)
    total, widest = 0, 1
    for c in range(count):
        if is_on_path[c]:
            total += cliques.columns[c]
            widest = max(widest, cliques.rows[c])
    below = np.zeros((size, m))
    for k in range(len(columns)):
        for i in range(m):
            below[columns[k], i] += right[i, k]
    reached, Y, gradient, found = (
        np.empty(total, np.int64),
        np.empty((total, m)),
        np.empty(total),
        0,
    )
    work = np.empty((m, widest))
    for k in range(count):
        c = count - 1 - k if k < count - renewed else k - (count - renewed)
        if not is_on_path[c]:
            continue
        rows, begin = cliques.rows[c], cliques.row_starts[c]
        for at in range(rows - 1):
            for i in range(m):
                work[i, at] = below[cliques.row_pool[begin + at], i]
        for j in range(cliques.columns[c]):
            column = cliques.panel_starts[c] + j * rows
            reached[found], gradient[found] = (
                cliques.row_pool[begin + j], cliques.pool[column + rows - 1],
            )  # fmt: skip
            last = min(j // _AT_ONCE * _AT_ONCE + _AT_ONCE, cliques.columns[c])
            for i in range(m):
                y = work[i, j] / cliques.pool[column + j]
                Y[found, i] = y
                for at in range(j + 1, last):
                    work[i, at] -= cliques.pool[column + at] * y
                if j == last - 1:
                    _subtract_columns(
                        work[i, last : rows - 1], cliques.pool, column + last, rows,
                        Y[found + 1 - (last - j // _AT_ONCE * _AT_ONCE) : found + 1, i],
                    )  # fmt: skip
            found += 1
        for at in range(cliques.columns[c], rows - 1):
            for i in range(m):
                below[cliques.row_pool[begin + at], i] = work[i, at]
    return reached, Y, gradient


@compiled
def squared(Y: Floats) -> Floats:
    """Return Y^T Y, (m, m), of Y (n, m)."""
    m = Y.shape[1]
    result = np.zeros((m, m))
    for k in range(len(Y)):
        for i in range(m):
            for j in range(m):
                result[i, j] += Y[k, i] * Y[k, j]
    return result
