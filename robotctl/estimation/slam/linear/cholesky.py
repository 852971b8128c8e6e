"""The Cholesky factor of a sparse matrix, by fronts, and the solution of equations with it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robotctl.compiled import compiled
from robotctl.estimation.slam.linear.symbolic import Symbolic

Floats = NDArray[np.float64]
SMALLEST = 1e-14
"""A pivot that lost all but this share of its diagonal entry is no pivot: rounding is as large."""


@compiled
def subtract_product(target: Floats, a: Floats, scale: float) -> None:
    """Subtract `scale` times `a` from `target`, (n,)."""
    for i in range(len(target)):
        target[i] -= scale * a[i]


@compiled
def subtract_four(
    target: Floats, a: Floats, b: Floats, c: Floats, d: Floats, scales: tuple[float, ...]
) -> None:
    """Subtract four scaled vectors from `target` in one pass, (n,)."""
    s, t, u, v = scales
    for i in range(len(target)):
        target[i] -= s * a[i] + t * b[i] + u * c[i] + v * d[i]


@compiled
def _subtract_columns(target: Floats, panel: Floats, rows: int, at: int, count: int) -> None:
    """Subtract the first columns of a panel, each times its entry in row `at`, from that row on.

    Four columns in one pass: the target is read and written a quarter as often.
    """
    k = 0
    while k + 3 < count:
        p = k * rows
        subtract_four(
            target,
            panel[p + at : p + rows],
            panel[p + rows + at : p + 2 * rows],
            panel[p + 2 * rows + at : p + 3 * rows],
            panel[p + 3 * rows + at : p + 4 * rows],
            (
                panel[p + at],
                panel[p + rows + at],
                panel[p + 2 * rows + at],
                panel[p + 3 * rows + at],
            ),
        )
        k += 4
    while k < count:
        subtract_product(target, panel[k * rows + at : (k + 1) * rows], panel[k * rows + at])
        k += 1


@compiled
def eliminate(panel: Floats, rows: int, columns: int, update: Floats) -> int:
    """Factor the columns of a front in place, and subtract them from what lies behind.

    Parameters
    ----------
    panel
        The columns, (rows * columns,), stored by columns; the upper triangle is not read.
    rows, columns
        Of the front.
    update
        The rest of the front by columns, ((rows - columns)^2,), of which the lower triangle is
        read and written.

    Returns
    -------
    int
        The first column without a positive pivot; -1 if all have one.
    """
    for j in range(columns):
        before = panel[j * rows + j]
        column = panel[j * rows + j : (j + 1) * rows]
        _subtract_columns(column, panel, rows, j, j)
        pivot = column[0]
        if not pivot > SMALLEST * before:
            return j
        root = np.sqrt(pivot)
        column[0] = root
        inverse = 1.0 / root
        for i in range(1, len(column)):
            column[i] *= inverse
    size = rows - columns
    for j in range(size):
        target = update[j * size + j : (j + 1) * size]
        _subtract_columns(target, panel, rows, columns + j, columns)
    return -1


@compiled
def add_update(
    child: Floats, relative: NDArray[np.int64], panel: Floats, rows: int, columns: int,
    update: Floats,
) -> None:  # fmt: skip
    """Add the update of a child, (k * k,) by columns, to a front at the places `relative`, (k,)."""
    size, behind = len(relative), rows - columns
    for j in range(size):
        column = relative[j]
        if column < columns:
            base = column * rows
            for i in range(j, size):
                panel[base + relative[i]] += child[j * size + i]
        else:
            base = (column - columns) * behind - columns
            for i in range(j, size):
                update[base + relative[i]] += child[j * size + i]


@compiled
def factorise(symbolic: Symbolic, panels: Floats, stack: Floats) -> int:
    """Replace a matrix by its Cholesky factor.

    Parameters
    ----------
    symbolic
        Its structure.
    panels
        Lower triangle of the matrix in the columns of the fronts; where `locate` says.
    stack
        Space for `symbolic.stack_size` numbers.

    Returns
    -------
    int
        The first column (in the order of elimination) without a positive pivot; -1 if the matrix
        is positive definite.
    """
    total = len(symbolic.parents)
    children = np.full(total, -1, np.int64)  # the last one pushed, and by it the one before
    before = np.full(total, -1, np.int64)
    begins = np.zeros(total, np.int64)
    top = 0
    for s in range(total):
        low = symbolic.row_starts[s]
        rows = symbolic.row_starts[s + 1] - low
        columns = symbolic.columns[s + 1] - symbolic.columns[s]
        size = rows - columns
        panel = panels[symbolic.panel_starts[s] : symbolic.panel_starts[s + 1]]
        update = stack[top : top + size * size]
        update[:] = 0.0
        base = top
        child = children[s]
        while child >= 0:
            first = symbolic.row_starts[child] + (
                symbolic.columns[child + 1] - symbolic.columns[child]
            )
            relative = symbolic.relative[first : symbolic.row_starts[child + 1]]
            base = begins[child]
            add_update(
                stack[base : base + len(relative) ** 2], relative, panel, rows, columns, update
            )
            child = before[child]
        failed = eliminate(panel, rows, columns, update)
        if failed >= 0:
            return int(symbolic.columns[s] + failed)
        if base < top:
            for i in range(size * size):
                stack[base + i] = stack[top + i]
        begins[s] = base
        top = base + size * size
        up = symbolic.parents[s]
        if up >= 0:
            before[s] = children[up]
            children[up] = s
    return -1


@compiled
def solve_lower(symbolic: Symbolic, panels: Floats, x: Floats) -> None:
    """Replace x by the solution of L y = x, (n,)."""
    work = np.empty(len(x))
    for s in range(len(symbolic.parents)):
        low = symbolic.row_starts[s]
        rows = symbolic.row_starts[s + 1] - low
        first = symbolic.columns[s]
        columns = symbolic.columns[s + 1] - first
        base = symbolic.panel_starts[s]
        if columns == rows:
            behind = work[:0]
        else:
            behind = work[: rows - columns]
            behind[:] = 0.0
        for j in range(columns):
            column = panels[base + j * rows + j : base + (j + 1) * rows]
            value = x[first + j] / column[0]
            x[first + j] = value
            for i in range(1, columns - j):
                x[first + j + i] -= column[i] * value
            subtract_product(behind, column[columns - j :], value)
        for i in range(rows - columns):
            x[symbolic.rows[low + columns + i]] += behind[i]


@compiled
def solve_upper(symbolic: Symbolic, panels: Floats, x: Floats) -> None:
    """Replace x by the solution of L^T y = x, (n,)."""
    work = np.empty(len(x))
    for s in range(len(symbolic.parents) - 1, -1, -1):
        low = symbolic.row_starts[s]
        rows = symbolic.row_starts[s + 1] - low
        first = symbolic.columns[s]
        columns = symbolic.columns[s + 1] - first
        base = symbolic.panel_starts[s]
        for i in range(rows):
            work[i] = x[symbolic.rows[low + i]]
        for j in range(columns - 1, -1, -1):
            column = panels[base + j * rows + j : base + (j + 1) * rows]
            value = work[j]
            for i in range(1, rows - j):
                value -= column[i] * work[j + i]
            work[j] = value / column[0]
            x[first + j] = work[j]


@compiled
def multiply(symbolic: Symbolic, panels: Floats, x: Floats) -> Floats:
    """Return A x of a symmetric matrix whose lower triangle stands in the fronts, (n,)."""
    y = np.zeros(len(x))
    for s in range(len(symbolic.parents)):
        low = symbolic.row_starts[s]
        rows = symbolic.row_starts[s + 1] - low
        first = symbolic.columns[s]
        for j in range(symbolic.columns[s + 1] - first):
            base = symbolic.panel_starts[s] + j * rows
            y[first + j] += panels[base + j] * x[first + j]
            for i in range(j + 1, rows):
                row = symbolic.rows[low + i]
                y[row] += panels[base + i] * x[first + j]
                y[first + j] += panels[base + i] * x[row]
    return y
