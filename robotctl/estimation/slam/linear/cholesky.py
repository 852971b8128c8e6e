"""The Cholesky factor of a sparse matrix, by fronts, and the solution of equations with it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.estimation.slam.linear.symbolic import Symbolic, odd_depths

Floats = NDArray[np.float64]
SMALLEST = 1e-14
"""A pivot that lost all but this share of its diagonal entry is no pivot: rounding is as large."""

_TILE = 64
"""Columns and rows of a tile: OpenBLAS shares out no product of so few among threads."""
_BLOCK = 16
"""Columns that are eliminated one by one before later ones hear of them."""
_FEW = 24
"""Pairs of columns up to which a loop is as fast as BLAS."""


@compiled
def subtract_product(target: Floats, a: Floats, scale: float) -> None:
    """Subtract `scale` times `a` from `target`, (n,)."""
    for i in range(len(target)):
        target[i] -= scale * a[i]


@compiled
def _subtract_four(x: Floats, y: Floats, done: Floats) -> None:
    """Subtract four finished columns from two, in their order.

    So many at once load and store a column less often.

    Parameters
    ----------
    x, y
        Two columns that follow each other, (n,), from the first one's diagonal on; both changed.
    done
        Finished columns from there on, (4, n).
    """
    a, b, c, d = done[0], done[1], done[2], done[3]
    p, q, r, s = a[0], b[0], c[0], d[0]
    t, u, v, w = a[1], b[1], c[1], d[1]
    for i in range(len(x)):
        x[i] = x[i] - a[i] * p - b[i] * q - c[i] * r - d[i] * s
        y[i] = y[i] - a[i] * t - b[i] * u - c[i] * v - d[i] * w


@compiled
def _subtract_products(done: Floats, first: int, last: int, target: Floats, shift: int) -> None:
    """Subtract finished columns from later ones, tile by tile through BLAS.

    Parameters
    ----------
    done
        Finished columns of a front, (k, rows).
    first, last
        Columns to subtract them from, of all those of the front.
    target, shift
        Where these stand: column j, row i is `target[j - shift, i - shift]`; rows above the
        diagonal may be changed, too.
    """
    count, rows = done.shape
    if count * (last - first) <= _FEW:
        for j in range(first, last):
            for m in range(count):
                scale = done[m, j]
                for i in range(j, rows):
                    target[j - shift, i - shift] -= scale * done[m, i]
        return
    for m in range(0, count, _TILE):
        inner = min(m + _TILE, count)
        for j in range(first, last, _TILE):
            wide = min(j + _TILE, last)
            left = done[m:inner, j:wide].copy()
            for i in range(j, rows, _TILE):
                high = min(i + _TILE, rows)
                product = np.dot(left.T, done[m:inner, i:high].copy())
                for a in range(wide - j):
                    for b in range(high - i):
                        target[j - shift + a, i - shift + b] -= product[a, b]


@compiled
def eliminate(  # noqa: C901 - one compiled loop
    panel: Floats, rows: int, columns: int, update: Floats
) -> int:
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
    front = panel.reshape(columns, rows)
    before = np.empty(columns)
    for j in range(columns):
        before[j] = front[j, j]
    for k in range(0, columns, _BLOCK):
        end = min(k + _BLOCK, columns)
        tile = k // _TILE * _TILE
        if 0 < k == tile:
            _subtract_products(front[:k], k, min(k + _TILE, columns), front, 0)
        if k > tile:
            _subtract_products(front[tile:k], k, end, front, 0)
        for j in range(k, end):
            four = k + (j - k) // 4 * 4
            if j == four and j > k:
                for i in range(j, end - 1, 2):
                    _subtract_four(front[i, i:], front[i + 1, i:], front[j - 4 : j, i:])
                if (end - j) % 2:
                    for m in range(j - 4, j):
                        subtract_product(
                            front[end - 1, end - 1 :], front[m, end - 1 :], front[m, end - 1]
                        )
            for m in range(four, j):
                subtract_product(front[j, j:], front[m, j:], front[m, j])
            pivot = front[j, j]
            if not pivot > SMALLEST * before[j]:
                return j
            root = np.sqrt(pivot)
            front[j, j] = root
            inverse = 1.0 / root
            for i in range(j + 1, rows):
                front[j, i] *= inverse
    size = rows - columns
    if size > 0:
        _subtract_products(front, columns, rows, update.reshape(size, size), columns)
    return -1


@compiled
def add_update(
    child: Floats, relative: NDArray[np.int64], panel: Floats, rows: int, columns: int,
    update: Floats,
) -> None:  # fmt: skip
    """Add the update of a child, (k * k,) by columns, to a front at the places `relative`, (k,)."""
    size, behind = len(relative), rows - columns
    ends = np.empty(size, np.int64)  # of the run of successive places that each is in
    for j in range(size - 1, -1, -1):
        goes_on = j + 1 < size and relative[j + 1] == relative[j] + 1
        ends[j] = ends[j + 1] if goes_on else j + 1
    for j in range(size):
        column = relative[j]
        if column < columns:
            target = panel[column * rows : (column + 1) * rows]
            shift = 0
        else:
            target = update[(column - columns) * behind : (column - columns + 1) * behind]
            shift = columns
        i = j
        while i < size:
            begin, count = relative[i] - shift, ends[i] - i
            own, there = child[j * size + i : j * size + i + count], target[begin : begin + count]
            for k in range(count):
                there[k] += own[k]
            i = ends[i]


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
    is_odd = odd_depths(symbolic.parents)
    low_end, high_end = 0, len(stack)
    for s in range(total):
        low = symbolic.row_starts[s]
        rows = symbolic.row_starts[s + 1] - low
        columns = symbolic.columns[s + 1] - symbolic.columns[s]
        size = rows - columns
        panel = panels[symbolic.panel_starts[s] : symbolic.panel_starts[s + 1]]
        # Children lie at one end of the stack, their parent goes to the other one.
        if is_odd[s]:
            high_end -= size * size
            begins[s] = high_end
        else:
            begins[s] = low_end
            low_end += size * size
        update = stack[begins[s] : begins[s] + size * size]
        for j in range(size):
            update[j * size + j : (j + 1) * size] = 0.0
        child = children[s]
        while child >= 0:
            first = symbolic.row_starts[child] + (
                symbolic.columns[child + 1] - symbolic.columns[child]
            )
            relative = symbolic.relative[first : symbolic.row_starts[child + 1]]
            taken = len(relative) ** 2
            base = begins[child]
            add_update(stack[base : base + taken], relative, panel, rows, columns, update)
            if is_odd[s]:
                low_end -= taken
            else:
                high_end += taken
            child = before[child]
        failed = eliminate(panel, rows, columns, update)
        if failed >= 0:
            return int(symbolic.columns[s] + failed)
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
