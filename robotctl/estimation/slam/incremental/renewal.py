"""Taking apart the cliques that new factors reach, and eliminating their variables again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robotctl.compiled import compiled
from robotctl.estimation.slam.incremental.bayes_tree import (
    Cliques,
    Links,
    grown_floats,
    grown_ints,
)
from robotctl.estimation.slam.linear.cholesky import add_update, eliminate
from robotctl.estimation.slam.linear.ordering import minimum_degree
from robotctl.estimation.slam.linear.symbolic import Symbolic, analyse

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_MOST_DAMPING = 1e9
"""Greatest damping, as a multiple of the diagonal; nothing is singular then."""


@compiled
def _affected(cliques: Cliques, clique_of: Ints, touched: Ints, owner: Ints) -> tuple[Ints, Ints]:  # noqa: C901 - one compiled loop
    """Return the variables to eliminate again, and the subtrees that are cut off.

    The cliques that go are marked as gone.
    """
    count = cliques.used[0]
    is_gone = np.zeros(count + 1, np.bool_)
    variables, found = np.empty(len(owner) + len(touched), np.int64), 0
    for v in touched:
        c = clique_of[v]
        if c == -1:
            variables[found] = v
            found += 1
            clique_of[v] = -2  # once
        while c >= 0 and not is_gone[c]:
            is_gone[c] = True
            c = cliques.parents[c]
    orphans, cut = np.empty(count, np.int64), 0
    for c in range(count):
        up = cliques.parents[c]
        if is_gone[c]:
            for at in range(cliques.row_starts[c], cliques.row_starts[c] + cliques.columns[c]):
                v = owner[cliques.row_pool[at]]
                if clique_of[v] == c:
                    variables[found] = v
                    found += 1
                    clique_of[v] = -2
        elif up >= 0 and is_gone[up]:
            orphans[cut] = c
            cut += 1
    for c in range(count):
        if is_gone[c]:
            cliques.parents[c] = -2
    return variables[:found], orphans[:cut]


@compiled
def _graph(  # noqa: C901 - one compiled loop
    cliques: Cliques, links: Links, variables: Ints, orphans: Ints, local: Ints
) -> tuple[Ints, Ints]:
    """Return the neighbours of each affected variable, the gradient as one more variable."""
    n = len(variables)
    entries = 0
    for c in orphans:
        entries += cliques.rows[c] - cliques.columns[c]
    heads, chain, of = (
        np.full(n, -1, np.int64),
        np.empty(entries, np.int64),
        np.empty(entries, np.int64),
    )
    count = 0
    for c in orphans:
        last = -1
        for at in range(
            cliques.row_starts[c] + cliques.columns[c], cliques.row_starts[c] + cliques.rows[c] - 1
        ):
            i = local[links.owner[cliques.row_pool[at]]]
            if i != last:
                of[count], chain[count], heads[i] = c, heads[i], count
                count += 1
                last = i
    starts, neighbours = np.zeros(n + 2, np.int64), np.empty(8 * n + 8, np.int64)
    mark = np.full(n, -1, np.int64)
    used = 0
    for i in range(n):
        mark[i] = i
        if used + n > len(neighbours):
            neighbours = grown_ints(neighbours, used, n)
        entry = links.heads[variables[i]]
        while entry >= 0:
            factor = entry // 2
            other = links.second[factor] if entry % 2 == 0 else links.first[factor]
            if other >= 0:
                j = local[other]
                if j >= 0 and mark[j] != i:
                    mark[j] = i
                    neighbours[used] = j
                    used += 1
            entry = links.following[entry]
        at = heads[i]
        while at >= 0:
            c = of[at]
            for row in range(
                cliques.row_starts[c] + cliques.columns[c],
                cliques.row_starts[c] + cliques.rows[c] - 1,
            ):
                j = local[links.owner[cliques.row_pool[row]]]
                if mark[j] != i:
                    mark[j] = i
                    neighbours[used] = j
                    used += 1
            at = chain[at]
        starts[i + 1] = used
    return starts, neighbours[:used]


@compiled
def _with_gradient(starts: Ints, neighbours: Ints, n: int) -> tuple[Ints, Ints]:
    """Return a graph with one more variable, which meets all."""
    wide_starts, wide = np.zeros(n + 2, np.int64), np.empty(len(neighbours) + 2 * n, np.int64)
    used = 0
    for i in range(n):
        for at in range(starts[i], starts[i + 1]):
            wide[used] = neighbours[at]
            used += 1
        wide[used] = n
        used += 1
        wide_starts[i + 1] = used
    for i in range(n):
        wide[used] = i
        used += 1
    wide_starts[n + 1] = used
    return wide_starts, wide


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
def _assemble(
    symbolic: Symbolic, links: Links, variables: Ints, local: Ints, position: Ints, panels: Floats
) -> None:
    """Add up the factors: all that the affected variables have of their own, and between them.

    Updates of orphans hold only what elimination subtracts.
    """
    last = len(variables)
    for i in range(len(variables)):
        entry = links.heads[variables[i]]
        while entry >= 0:
            factor, slot = entry // 2, entry % 2
            a, b = links.first[factor], links.second[factor]
            da = links.dof[a]
            db = links.dof[b] if b >= 0 else 0
            width, at = da + db, links.places[factor]
            own, skip = (da, 0) if slot == 0 else (db, da)
            pa = position[i]
            place, stride = _place(symbolic, pa, pa)
            row, along = _place(symbolic, last, pa)
            for j in range(own):
                for k in range(own):
                    panels[place + j * stride + k] += links.terms[
                        at + (skip + j) * width + skip + k
                    ]
                panels[row + j * along] += links.terms[at + width * width + skip + j]
            if slot == 0 and b >= 0 and local[b] >= 0:
                pb = position[local[b]]
                place, stride = _place(symbolic, max(pa, pb), min(pa, pb))
                for j in range(da):
                    for k in range(db):
                        value = links.terms[at + j * width + da + k]
                        if pa < pb:
                            panels[place + j * stride + k] += value
                        else:
                            panels[place + k * stride + j] += value
            entry = links.following[entry]


@compiled
def _eliminate_all(  # noqa: C901 - one compiled loop
    symbolic: Symbolic, cliques: Cliques, orphans: Ints, homes: Ints, column_of: Ints,
    panels: Floats, updates: Floats, update_starts: Ints,
) -> bool:  # fmt: skip
    """Factor all new fronts, with the updates of the orphans in them; False if that fails."""
    total = len(symbolic.parents)
    heads, chain = np.full(total, -1, np.int64), np.full(len(orphans), -1, np.int64)
    for k in range(len(orphans)):
        chain[k], heads[homes[k]] = heads[homes[k]], k
    children, beside = np.full(total, -1, np.int64), np.full(total, -1, np.int64)
    place = np.zeros(symbolic.scalars[len(symbolic.order)], np.int64)
    for s in range(total):
        low = symbolic.row_starts[s]
        rows = symbolic.row_starts[s + 1] - low
        columns = _columns(symbolic, s)
        size = rows - columns
        panel = panels[symbolic.panel_starts[s] : symbolic.panel_starts[s] + rows * columns]
        update = updates[update_starts[s] : update_starts[s] + size * size]
        for i in range(size * size):
            update[i] = 0.0
        child = children[s]
        while child >= 0:
            own = symbolic.columns[child + 1] - symbolic.columns[child]
            relative = symbolic.relative[
                symbolic.row_starts[child] + own : symbolic.row_starts[child + 1]
            ]
            k = len(relative)
            theirs = updates[update_starts[child] : update_starts[child] + k * k]
            add_update(theirs, relative, panel, rows, columns, update)
            child = beside[child]
        k = heads[s]
        if k >= 0:
            for at in range(low, low + rows):
                place[symbolic.rows[at]] = at - low
        while k >= 0:
            c = orphans[k]
            behind = cliques.rows[c] - cliques.columns[c]
            relative = np.empty(behind, np.int64)
            begin = cliques.row_starts[c] + cliques.columns[c]
            for i in range(behind - 1):
                relative[i] = place[column_of[cliques.row_pool[begin + i]]]
            relative[behind - 1] = rows - 1
            _add_any(cliques.pool, cliques.update_starts[c], relative, panel, rows, columns, update)
            k = chain[k]
        if eliminate(panel, rows, columns, update) >= 0:
            return False
        up = symbolic.parents[s]
        if up >= 0:
            beside[s], children[up] = children[up], s
    return True


@compiled
def _add_any(
    pool: Floats, begin: int, relative: Ints, panel: Floats, rows: int, columns: int,
    update: Floats,
) -> None:  # fmt: skip
    """Add the update of an orphan; its rows may stand in another order than before."""
    size, behind = len(relative), rows - columns
    for j in range(size):
        for i in range(j, size):
            high, low = max(relative[i], relative[j]), min(relative[i], relative[j])
            value = pool[begin + j * size + i]
            if low < columns:
                panel[low * rows + high] += value
            else:
                update[(low - columns) * behind + high - columns] += value


@compiled
def _analysed(
    cliques: Cliques, links: Links, variables: Ints, orphans: Ints, local: Ints,
    is_new: NDArray[np.bool_],
) -> Symbolic:  # fmt: skip
    """Return the structure of the factor of the affected variables, the gradient behind them."""
    n = len(variables)
    dof, is_last = np.empty(n + 1, np.int64), np.empty(n, np.bool_)
    for i in range(n):
        dof[i], is_last[i] = links.dof[variables[i]], is_new[variables[i]]
    dof[n] = 1
    starts, neighbours = _graph(cliques, links, variables, orphans, local)
    order = np.empty(n + 1, np.int64)
    order[:n] = minimum_degree(starts[: n + 1], neighbours, dof[:n], is_last)
    order[n] = n
    wide_starts, wide = _with_gradient(starts, neighbours, n)
    return analyse(wide_starts, wide, order, dof)


@compiled
def _column_maps(
    symbolic: Symbolic, links: Links, variables: Ints, position: Ints
) -> tuple[Ints, Ints]:
    """Return the affected column of each column of the whole system, else -1, and the inverse."""
    n = len(variables)
    column_of = np.full(len(links.owner), -1, np.int64)
    whole = np.full(symbolic.scalars[n + 1], -1, np.int64)
    for i in range(n):
        v = variables[i]
        for k in range(links.dof[v]):
            column_of[links.offsets[v] + k] = symbolic.scalars[position[i]] + k
            whole[symbolic.scalars[position[i]] + k] = links.offsets[v] + k
    return column_of, whole


@compiled
def _homes(
    symbolic: Symbolic, cliques: Cliques, links: Links, orphans: Ints, local: Ints, position: Ints
) -> Ints:
    """Return the new front that takes the update of each orphan: that of its first row."""
    homes = np.full(len(orphans), len(symbolic.parents) - 1, np.int64)
    for k in range(len(orphans)):
        c = orphans[k]
        least = len(position) - 1
        for at in range(
            cliques.row_starts[c] + cliques.columns[c], cliques.row_starts[c] + cliques.rows[c] - 1
        ):
            least = min(least, position[local[links.owner[cliques.row_pool[at]]]])
        homes[k] = symbolic.supernode[least]
    return homes


@compiled
def _columns(symbolic: Symbolic, s: int) -> int:
    """Return how many columns of a front are eliminated: that of the gradient is not."""
    last = 1 if s == len(symbolic.parents) - 1 else 0
    count: int = symbolic.columns[s + 1] - symbolic.columns[s] - last
    return count


@compiled
def _update_starts(symbolic: Symbolic) -> Ints:
    """Return where the update of each front begins, and the end of all."""
    total = len(symbolic.parents)
    starts = np.zeros(total + 1, np.int64)
    for s in range(total):
        size = symbolic.row_starts[s + 1] - symbolic.row_starts[s] - _columns(symbolic, s)
        starts[s + 1] = starts[s] + size * size
    return starts


@compiled
def _damp(symbolic: Symbolic, variables: int, damping: float, panels: Floats) -> None:
    """Enlarge the diagonal of the first positions by `damping` times itself, and a little."""
    for k in range(variables):
        place, stride = _place(symbolic, k, k)
        for j in range(symbolic.scalars[k + 1] - symbolic.scalars[k]):
            panels[place + j * (stride + 1)] *= 1.0 + damping
            panels[place + j * (stride + 1)] += 1e-6 * damping


@compiled
def _stored(
    symbolic: Symbolic, cliques: Cliques, links: Links, clique_of: Ints, whole: Ints,
    panels: Floats, updates: Floats, update_starts: Ints,
) -> Cliques:  # fmt: skip
    """Return the tree with the new fronts as its last cliques; `clique_of` is changed."""
    total, used = len(symbolic.parents), cliques.used
    base, row_at, at = used[0], used[1], used[2]
    pool = grown_floats(cliques.pool, at, len(panels) + len(updates))
    row_pool = grown_ints(cliques.row_pool, row_at, len(symbolic.rows))
    parents = grown_ints(cliques.parents, base, total)
    columns_of = grown_ints(cliques.columns, base, total)
    rows_of = grown_ints(cliques.rows, base, total)
    row_starts = grown_ints(cliques.row_starts, base, total)
    panel_starts = grown_ints(cliques.panel_starts, base, total)
    own_updates = grown_ints(cliques.update_starts, base, total)
    for s in range(total):
        c = base + s
        rows = symbolic.row_starts[s + 1] - symbolic.row_starts[s]
        columns = _columns(symbolic, s)
        parents[c] = base + symbolic.parents[s] if symbolic.parents[s] >= 0 else -1
        columns_of[c], rows_of[c] = columns, rows
        row_starts[c], panel_starts[c] = row_at, at
        for k in range(rows):
            row_pool[row_at + k] = whole[symbolic.rows[symbolic.row_starts[s] + k]]
            if k < columns:
                clique_of[links.owner[row_pool[row_at + k]]] = c
        row_at += rows
        for k in range(rows * columns):
            pool[at + k] = panels[symbolic.panel_starts[s] + k]
        at += rows * columns
        own_updates[c] = at
        for k in range(update_starts[s + 1] - update_starts[s]):
            pool[at + k] = updates[update_starts[s] + k]
        at += update_starts[s + 1] - update_starts[s]
    used[0], used[1], used[2] = base + total, row_at, at
    return Cliques(
        parents, columns_of, rows_of, row_starts, panel_starts, own_updates, row_pool, pool, used
    )


@compiled
def renew(
    cliques: Cliques, links: Links, clique_of: Ints, touched: Ints, is_new: NDArray[np.bool_]
) -> tuple[Cliques, int]:
    """Eliminate again all that factors of some variables reach.

    Parameters
    ----------
    cliques, links
        The tree, which is changed, and the graph.
    clique_of
        Where each variable is eliminated; -1: nowhere yet. Changed.
    touched
        Variables whose factors changed.
    is_new
        Which variables are to be eliminated last, (n,).

    Returns
    -------
    cliques : Cliques
        The tree; its arrays may be other ones.
    first : int
        From this clique on all are new; -1 where no damping makes the matrix positive definite, as
        with numbers that are not finite. Then the tree is of no use any more.
    """
    variables, orphans = _affected(cliques, clique_of, touched, links.owner)
    n = len(variables)
    local = np.full(len(clique_of), -1, np.int64)
    for i in range(n):
        local[variables[i]] = i
    symbolic = _analysed(cliques, links, variables, orphans, local, is_new)
    position = np.empty(n + 1, np.int64)
    for k in range(n + 1):
        position[symbolic.order[k]] = k
    column_of, whole = _column_maps(symbolic, links, variables, position)
    homes = _homes(symbolic, cliques, links, orphans, local, position)
    update_starts = _update_starts(symbolic)
    updates = np.empty(update_starts[-1])
    damping = 0.0
    while True:
        panels = np.zeros(symbolic.panel_starts[-1])
        _assemble(symbolic, links, variables, local, position, panels)
        if damping > 0.0:
            _damp(symbolic, n, damping, panels)
        if _eliminate_all(
            symbolic, cliques, orphans, homes, column_of, panels, updates, update_starts
        ):
            break
        damping = max(1e-9, 100.0 * damping)
        if damping > _MOST_DAMPING:
            return cliques, -1
    base = cliques.used[0]
    for k in range(len(orphans)):
        cliques.parents[orphans[k]] = base + homes[k]
    return _stored(symbolic, cliques, links, clique_of, whole, panels, updates, update_starts), base
