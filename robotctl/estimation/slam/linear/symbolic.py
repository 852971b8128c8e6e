"""Symbolic Cholesky factor: supernodes and their fronts, which follow from the structure alone.

A front is a dense matrix over the columns of one supernode and the rows below them; factors are
computed front by front, from the leaves of the elimination tree to its roots (the multifrontal
method: Duff and Reid, ACM TOMS 9, 1983; Liu, SIAM Review 34, 1992). Supernodes that are small or
nearly alike are merged, at the price of some zeros (Ashcraft and Grimes, ACM TOMS 15, 1989).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled

Ints = NDArray[np.int64]


class Symbolic(NamedTuple):
    """The structure of a factor; positions are places in the order of elimination.

    Parameters
    ----------
    order
        Variables in the order of elimination, (n,).
    scalars
        First column of each position, (n + 1,).
    supernode
        Of each position, (n,).
    columns
        First column of each supernode, (s + 1,).
    parents
        Of each supernode, (s,); -1 for roots. Children stand before their parents.
    row_starts, rows
        Columns and rows of the front of s: `rows[row_starts[s] : row_starts[s + 1]]`, ascending.
    relative
        For each row, its place in the front of the parent; of columns: 0.
    panel_starts
        Of the columns of each front in the array of the factor, (s + 1,); stored by columns.
    stack_size
        Numbers that the updates on their way to the parents take at most.
    """

    order: Ints
    scalars: Ints
    supernode: Ints
    columns: Ints
    parents: Ints
    row_starts: Ints
    rows: Ints
    relative: Ints
    panel_starts: Ints
    stack_size: int


@compiled
def _elimination_tree(starts: Ints, neighbours: Ints, order: Ints, position: Ints) -> Ints:
    """Return the parent of each position (Liu 1990)."""
    n = len(order)
    parent, ancestor = np.full(n, -1, np.int64), np.full(n, -1, np.int64)
    for k in range(n):
        for at in range(starts[order[k]], starts[order[k] + 1]):
            i = position[neighbours[at]]
            while i != -1 and i < k:
                above = ancestor[i]
                ancestor[i] = k
                if above == -1:
                    parent[i] = k
                i = above
    return parent


@compiled
def _structures(  # noqa: C901 - one compiled loop
    starts: Ints, neighbours: Ints, order: Ints, position: Ints, parent: Ints
) -> tuple[Ints, Ints]:
    """Return the positions below each column of the factor: where they begin, and all of them."""
    n = len(order)
    head, following = np.full(n, -1, np.int64), np.full(n, -1, np.int64)
    for j in range(n - 1, -1, -1):
        if parent[j] >= 0:
            following[j] = head[parent[j]]
            head[parent[j]] = j
    below = np.empty(4 * len(neighbours) + n, np.int64)
    begins = np.zeros(n + 1, np.int64)
    mark = np.full(n, -1, np.int64)
    used = 0
    for j in range(n):
        need = starts[order[j] + 1] - starts[order[j]]
        child = head[j]
        while child >= 0:
            need += begins[child + 1] - begins[child]
            child = following[child]
        if used + need > len(below):
            larger = np.empty(2 * len(below) + need, np.int64)
            for at in range(used):
                larger[at] = below[at]
            below = larger
        mark[j] = j
        for at in range(starts[order[j]], starts[order[j] + 1]):
            i = position[neighbours[at]]
            if i > j and mark[i] != j:
                mark[i] = j
                below[used] = i
                used += 1
        child = head[j]
        while child >= 0:
            for at in range(begins[child], begins[child + 1]):
                i = below[at]
                if mark[i] != j:
                    mark[i] = j
                    below[used] = i
                    used += 1
            child = following[child]
        begins[j + 1] = used
    return begins, below[:used]


@compiled
def _postorder(parent: Ints, sizes: Ints) -> Ints:  # noqa: C901 - one compiled loop
    """Return positions so that each subtree is contiguous, the child of most rows last."""
    n = len(parent)
    head, following, largest = (
        np.full(n, -1, np.int64),
        np.full(n, -1, np.int64),
        np.full(n, -1, np.int64),
    )
    for j in range(n - 1, -1, -1):
        up = parent[j]
        if up >= 0:
            following[j] = head[up]
            head[up] = j
            if largest[up] < 0 or sizes[j] > sizes[largest[up]]:
                largest[up] = j
    result, done = np.empty(n, np.int64), 0
    stack, is_open = np.empty(n, np.int64), np.zeros(n, np.bool_)
    for root in range(n):
        if parent[root] >= 0:
            continue
        stack[0], height = root, 1
        while height > 0:
            j = stack[height - 1]
            if is_open[j]:
                result[done] = j
                done += 1
                height -= 1
                continue
            is_open[j] = True
            if largest[j] >= 0:
                stack[height] = largest[j]
                height += 1
            child = head[j]
            while child >= 0:
                if child != largest[j]:
                    stack[height] = child
                    height += 1
                child = following[child]
    return result


@compiled
def _is_worth_it(columns: int, zeros: int, entries: int) -> bool:
    """Return whether a merged supernode of so many columns may hold so many zeros."""
    if columns <= 12:
        return zeros <= 0.6 * entries
    if columns <= 24:
        return zeros <= 0.3 * entries
    return zeros <= (0.15 if columns <= 60 else 0.05) * entries


@compiled
def _supernodes(parent: Ints, counts: Ints, begins: Ints, below: Ints, widths: Ints) -> Ints:
    """Return the first position of each supernode, and n behind them."""
    n = len(parent)
    firsts, own, height = np.empty(n + 1, np.int64), np.empty(n, np.int64), 0
    rows = np.zeros(n, np.int64)
    for j in range(n):
        for at in range(begins[j], begins[j + 1]):
            rows[j] += widths[below[at]]
    for j in range(n):
        # A supernode of one column, merged with those before it while that is worth it.
        first, width = j, widths[j]
        entries = width * (width + 1) // 2 + width * rows[j]
        while height > 0 and parent[first - 1] >= first and parent[first - 1] <= j:
            wide = width
            for k in range(firsts[height - 1], first):
                wide += widths[k]
            full = wide * (wide + 1) // 2 + wide * rows[j]
            together = entries + own[height - 1]
            is_same = counts[first - 1] == counts[j] + (j - first + 1)
            if not is_same and not _is_worth_it(wide, full - together, full):
                break
            height -= 1
            first, width, entries = firsts[height], wide, together
        firsts[height], own[height] = first, entries
        height += 1
    firsts[height] = n
    return firsts[: height + 1]


@compiled
def _in_order(
    begins: Ints, below: Ints, order: Ints, parent: Ints, post: Ints
) -> tuple[Ints, Ints, Ints, Ints]:
    """Return variables, parents and structures, where they begin and all, in another order.

    Parameters
    ----------
    begins, below, order, parent
        As they are.
    post
        Which position stands at each place of the new order.
    """
    n = len(order)
    renamed = np.empty(n, np.int64)
    for k in range(n):
        renamed[post[k]] = k
    new_order, new_parent = np.empty(n, np.int64), np.empty(n, np.int64)
    new_begins, new_below = np.zeros(n + 1, np.int64), np.empty(len(below), np.int64)
    at = 0
    for k in range(n):
        j = post[k]
        new_order[k] = order[j]
        new_parent[k] = -1 if parent[j] < 0 else renamed[parent[j]]
        for old in range(begins[j], begins[j + 1]):
            new_below[at] = renamed[below[old]]
            at += 1
        new_begins[k + 1] = at
    return new_order, new_parent, new_begins, new_below


@compiled
def _fronts(
    firsts: Ints, scalars: Ints, parent: Ints, begins: Ints, below: Ints
) -> tuple[Ints, Ints, Ints, Ints, Ints]:
    """Return the fronts of supernodes, which begin at the positions `firsts`.

    Returns
    -------
    supernode : ndarray, (n,)
    columns, parents, row_starts, panel_starts : ndarray
        See `Symbolic`.
    """
    total = len(firsts) - 1
    supernode, columns = np.empty(len(parent), np.int64), np.empty(total + 1, np.int64)
    for s in range(total + 1):
        columns[s] = scalars[firsts[s]]
    for s in range(total):
        for k in range(firsts[s], firsts[s + 1]):
            supernode[k] = s
    parents, row_starts = np.full(total, -1, np.int64), np.zeros(total + 1, np.int64)
    panel_starts = np.zeros(total + 1, np.int64)
    for s in range(total):
        last = firsts[s + 1] - 1
        width = columns[s + 1] - columns[s]
        height = width
        for at in range(begins[last], begins[last + 1]):
            height += scalars[below[at] + 1] - scalars[below[at]]
        row_starts[s + 1] = row_starts[s] + height
        panel_starts[s + 1] = panel_starts[s] + width * height
        if parent[last] >= 0:
            parents[s] = supernode[parent[last]]
    return supernode, columns, parents, row_starts, panel_starts


@compiled
def _rows_of_fronts(
    firsts: Ints, scalars: Ints, columns: Ints, row_starts: Ints, begins: Ints, below: Ints
) -> Ints:
    """Return the rows of all fronts, ascending in each."""
    n, total = len(scalars) - 1, len(firsts) - 1
    rows, filled = np.empty(row_starts[total], np.int64), np.empty(total, np.int64)
    # By the positions that have each position below them, all rows come out ascending.
    head, following = np.full(n, -1, np.int64), np.full(len(below), -1, np.int64)
    owner = np.empty(len(below), np.int64)
    for s in range(total):
        filled[s] = row_starts[s]
        for column in range(columns[s], columns[s + 1]):
            rows[filled[s]] = column
            filled[s] += 1
        for at in range(begins[firsts[s + 1] - 1], begins[firsts[s + 1]]):
            owner[at], following[at] = s, head[below[at]]
            head[below[at]] = at
    for i in range(n):
        at = head[i]
        while at >= 0:
            s = owner[at]
            for row in range(scalars[i], scalars[i + 1]):
                rows[filled[s]] = row
                filled[s] += 1
            at = following[at]
    return rows


@compiled
def _places_in_parents(columns: Ints, parents: Ints, row_starts: Ints, rows: Ints) -> Ints:
    """Return the place of each row in the front of the parent; 0 for columns."""
    relative, place = np.zeros(len(rows), np.int64), np.zeros(columns[-1], np.int64)
    for s in range(len(parents) - 1, -1, -1):
        if parents[s] >= 0:
            up = parents[s]
            for at in range(row_starts[up], row_starts[up + 1]):
                place[rows[at]] = at - row_starts[up]
            for at in range(row_starts[s] + columns[s + 1] - columns[s], row_starts[s + 1]):
                relative[at] = place[rows[at]]
    return relative


@compiled
def odd_depths(parents: Ints) -> NDArray[np.bool_]:
    """Return which supernodes are an odd number of steps below a root."""
    result = np.zeros(len(parents), np.bool_)
    for s in range(len(parents) - 1, -1, -1):
        if parents[s] >= 0:
            result[s] = not result[parents[s]]
    return result


@compiled
def _stack_size(columns: Ints, parents: Ints, row_starts: Ints) -> int:
    """Return how many numbers the updates on their way to the parents take at most."""
    waiting, peak, used = np.zeros(len(parents), np.int64), 0, 0
    for s in range(len(parents)):
        below = row_starts[s + 1] - row_starts[s] - (columns[s + 1] - columns[s])
        used += below * below
        peak = max(peak, used)
        used -= waiting[s]
        if parents[s] >= 0:
            waiting[parents[s]] += below * below
    return peak


@compiled
def analyse(starts: Ints, neighbours: Ints, order: Ints, dof: Ints) -> Symbolic:
    """Return the structure of the factor of a graph in an order of elimination.

    Parameters
    ----------
    starts, neighbours
        The graph, as for `minimum_degree`.
    order
        Variables, the first to be eliminated first; it is refined so that subtrees hang together.
    dof
        Degrees of freedom of each variable.
    """
    n = len(order)
    position = np.empty(n, np.int64)
    for k in range(n):
        position[order[k]] = k
    tree = _elimination_tree(starts, neighbours, order, position)
    begins, below = _structures(starts, neighbours, order, position, tree)
    post = _postorder(tree, begins[1:] - begins[:-1])
    variables, parent, begins, below = _in_order(begins, below, order, tree, post)
    widths, scalars = np.empty(n, np.int64), np.zeros(n + 1, np.int64)
    for k in range(n):
        widths[k] = dof[variables[k]]
        scalars[k + 1] = scalars[k] + widths[k]
    firsts = _supernodes(parent, begins[1:] - begins[:-1], begins, below, widths)
    supernode, columns, parents, row_starts, panel_starts = _fronts(
        firsts, scalars, parent, begins, below
    )
    rows = _rows_of_fronts(firsts, scalars, columns, row_starts, begins, below)
    return Symbolic(
        variables,
        scalars,
        supernode,
        columns,
        parents,
        row_starts,
        rows,
        _places_in_parents(columns, parents, row_starts, rows),
        panel_starts,
        _stack_size(columns, parents, row_starts),
    )


@compiled
def locate(symbolic: Symbolic, rows: Ints, columns: Ints) -> tuple[Ints, Ints]:
    """Return where blocks of the lower triangle stand in the array of the factor.

    Parameters
    ----------
    symbolic
        Of the factor.
    rows, columns
        Positions of each block, (m,), row >= column.

    Returns
    -------
    places, strides : ndarray, (m,)
        Of the first entry of each block, and from a column to the next.
    """
    places, strides = np.empty(len(rows), np.int64), np.empty(len(rows), np.int64)
    for k in range(len(rows)):
        s = symbolic.supernode[columns[k]]
        low, high = symbolic.row_starts[s], symbolic.row_starts[s + 1]
        strides[k] = high - low
        wanted, begin = symbolic.scalars[rows[k]], low
        while high - begin > 1:  # the place of a row that is there, by halves
            middle = (begin + high) // 2
            if symbolic.rows[middle] <= wanted:
                begin = middle
            else:
                high = middle
        row = begin - low
        column = symbolic.scalars[columns[k]] - symbolic.columns[s]
        places[k] = symbolic.panel_starts[s] + column * strides[k] + row
    return places, strides
