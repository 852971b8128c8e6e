"""The fronts of cliques that are eliminated again: added up from factors and orphans, factored."""

from __future__ import annotations

import numpy as np

from native_kernels.compiled import compiled
from robotctl.estimation.slam.incremental.bayes_tree import Cliques, Floats, Ints, Links
from robotctl.estimation.slam.linear.cholesky import eliminate
from robotctl.estimation.slam.linear.symbolic import Symbolic


@compiled
def front_columns(symbolic: Symbolic, s: int) -> int:
    """Return how many columns of a front are eliminated: that of the gradient is not."""
    last = 1 if s == len(symbolic.parents) - 1 else 0
    count: int = symbolic.columns[s + 1] - symbolic.columns[s] - last
    return count


@compiled
def _place(symbolic: Symbolic, row: int, column: int) -> tuple[int, int]:
    """Return where the block of two positions begins, and from a column of it to the next."""
    s = symbolic.supernode[column]
    low, high = symbolic.row_starts[s], symbolic.row_starts[s + 1]
    stride = high - low
    begin, wanted = low, symbolic.scalars[row]
    while high - begin > 1:
        middle = (begin + high) // 2
        if symbolic.rows[middle] <= wanted:
            begin = middle
        else:
            high = middle
    inside = symbolic.scalars[column] - symbolic.columns[s]
    return symbolic.panel_starts[s] + inside * stride + begin - low, stride


@compiled
def assemble(  # noqa: C901 - one compiled loop
    symbolic: Symbolic, links: Links, variables: Ints, local: Ints, position: Ints, panels: Floats
) -> None:
    """Add up the factors, from 0: all that the affected variables have of their own and between.

    Updates of orphans hold only what elimination subtracts.
    """
    for s in range(len(symbolic.parents)):
        rows, begin = symbolic.row_starts[s + 1] - symbolic.row_starts[s], symbolic.panel_starts[s]
        panels[begin : begin + rows * front_columns(symbolic, s)] = 0.0
    last = len(variables)
    for i in range(len(variables)):
        entry = links.heads[variables[i]]
        while entry >= 0:
            factor = links.factor_of[entry]
            first, last_entry = links.begins[factor], links.begins[factor + 1]
            width, skip, own = 0, 0, links.dof[variables[i]]
            for other in range(first, last_entry):
                if other == entry:
                    skip = width
                width += links.dof[links.ends[other]]
            at, pa = links.places[factor], position[i]
            place, stride = _place(symbolic, pa, pa)
            row, along = _place(symbolic, last, pa)
            for j in range(own):
                for k in range(own):
                    panels[place + j * stride + k] += links.terms[
                        at + (skip + j) * width + skip + k
                    ]
                panels[row + j * along] += links.terms[at + width * width + skip + j]
            ahead = skip + own
            for other in range(entry + 1, last_entry):
                v = links.ends[other]
                wide = links.dof[v]
                if local[v] >= 0:
                    pb = position[local[v]]
                    place, stride = _place(symbolic, max(pa, pb), min(pa, pb))
                    for j in range(own):
                        for k in range(wide):
                            value = links.terms[at + (skip + j) * width + ahead + k]
                            if pa < pb:
                                panels[place + j * stride + k] += value
                            else:
                                panels[place + k * stride + j] += value
                ahead += wide
            entry = links.following[entry]


@compiled
def damp(symbolic: Symbolic, variables: int, damping: float, panels: Floats) -> None:
    """Enlarge the diagonal of the first positions by `damping` times itself, and a little."""
    for k in range(variables):
        place, stride = _place(symbolic, k, k)
        for j in range(symbolic.scalars[k + 1] - symbolic.scalars[k]):
            panels[place + j * (stride + 1)] *= 1.0 + damping
            panels[place + j * (stride + 1)] += 1e-6 * damping


@compiled
def eliminate_all(  # noqa: C901 - one compiled loop
    symbolic: Symbolic, cliques: Cliques, orphans: Ints, homes: Ints, column_of: Ints, pool: Floats
) -> bool:  # fmt: skip
    """Factor all new fronts, with the updates of the orphans in them; False if that fails.

    Each update is packed behind the columns of its front.
    """
    total = len(symbolic.parents)
    heads, chain = np.full(total, -1, np.int64), np.full(len(orphans), -1, np.int64)
    for k in range(len(orphans)):
        chain[k], heads[homes[k]] = heads[homes[k]], k
    children, beside = np.full(total, -1, np.int64), np.full(total, -1, np.int64)
    place = np.zeros(symbolic.scalars[len(symbolic.order)], np.int64)
    space = np.empty(1)
    for s in range(total):
        low = symbolic.row_starts[s]
        rows = symbolic.row_starts[s + 1] - low
        columns = front_columns(symbolic, s)
        size = rows - columns
        begin = symbolic.panel_starts[s]
        panel = pool[begin : begin + rows * columns]
        if size * size > len(space):
            space = np.empty(size * size)
        update = space[: size * size]
        for j in range(size):
            update[j * size + j : (j + 1) * size] = 0.0  # above the diagonal nothing is read
        child = children[s]
        while child >= 0:
            first = symbolic.row_starts[child]
            own = front_columns(symbolic, child)
            relative = symbolic.relative[first + own : symbolic.row_starts[child + 1]]
            at = symbolic.panel_starts[child] + own * (own + len(relative))
            _add_packed(pool, at, relative, panel, rows, columns, update)
            child = beside[child]
        k = heads[s]
        if k >= 0:
            for at in range(low, low + rows):
                place[symbolic.rows[at]] = at - low
        while k >= 0:
            c = orphans[k]
            behind = cliques.rows[c] - cliques.columns[c]
            relative = np.empty(behind, np.int64)
            at = cliques.row_starts[c] + cliques.columns[c]
            for i in range(behind - 1):
                relative[i] = place[column_of[cliques.row_pool[at + i]]]
            relative[behind - 1] = rows - 1
            _add_packed(pool, cliques.update_starts[c], relative, panel, rows, columns, update)
            k = chain[k]
        if eliminate(panel, rows, columns, update) >= 0:
            return False
        at = begin + rows * columns
        for j in range(size):
            for i in range(j, size):
                pool[at] = update[j * size + i]
                at += 1
        up = symbolic.parents[s]
        if up >= 0:
            beside[s], children[up] = children[up], s
    return True


@compiled
def _add_packed(
    pool: Floats, begin: int, relative: Ints, panel: Floats, rows: int, columns: int,
    update: Floats,
) -> None:  # fmt: skip
    """Add an update to a front; an orphan's rows may stand in another order than before."""
    size, behind, at = len(relative), rows - columns, begin
    if _is_ascending(relative):
        for j in range(size):
            own = pool[at : at + size - j]
            if relative[j] < columns:
                target = panel[relative[j] * rows : (relative[j] + 1) * rows]
                for i in range(size - j):
                    target[relative[j + i]] += own[i]
            else:
                first = (relative[j] - columns) * behind
                target = update[first : first + behind]
                for i in range(size - j):
                    target[relative[j + i] - columns] += own[i]
            at += size - j
        return
    for j in range(size):
        for i in range(j, size):
            high, low = max(relative[i], relative[j]), min(relative[i], relative[j])
            if low < columns:
                panel[low * rows + high] += pool[at]
            else:
                update[(low - columns) * behind + high - columns] += pool[at]
            at += 1


@compiled
def _is_ascending(values: Ints) -> bool:
    """Return whether each value is larger than the one before."""
    for k in range(1, len(values)):  # noqa: SIM110 - compiled
        if values[k] <= values[k - 1]:
            return False
    return True
