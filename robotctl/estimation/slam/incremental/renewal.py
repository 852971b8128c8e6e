"""Taking apart the cliques that new factors reach, and eliminating their variables again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.estimation.slam.incremental.affected import analysed, take_apart
from robotctl.estimation.slam.incremental.bayes_tree import (
    Cliques,
    Ints,
    Links,
    grown_ints,
    packed,
    tidy,
    with_room,
)
from robotctl.estimation.slam.incremental.fronts import (
    assemble,
    damp,
    eliminate_all,
    front_columns,
)
from robotctl.estimation.slam.linear.symbolic import Symbolic

_GAPS = 5
"""One number in so many may be of cliques that are gone, before gaps are closed."""
_MOST_DAMPING = 1e9
"""Greatest damping, as a multiple of the diagonal; nothing is singular then."""


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
def _placed(symbolic: Symbolic, begin: int) -> Symbolic:
    """Return a structure whose fronts stand in the pool of the cliques from `begin` on."""
    total = len(symbolic.parents)
    starts = np.empty(total + 1, np.int64)
    starts[0] = begin
    for s in range(total):
        rows, columns = (
            symbolic.row_starts[s + 1] - symbolic.row_starts[s],
            front_columns(symbolic, s),
        )
        starts[s + 1] = starts[s] + rows * columns + packed(rows - columns)
    return Symbolic(
        symbolic.order, symbolic.scalars, symbolic.supernode, symbolic.columns, symbolic.parents,
        symbolic.row_starts, symbolic.rows, symbolic.relative, starts, symbolic.stack_size,
    )  # fmt: skip


@compiled
def _stored(
    symbolic: Symbolic, cliques: Cliques, links: Links, clique_of: Ints, whole: Ints
) -> Cliques:
    """Return the tree with the new fronts as its last cliques; `clique_of` is changed."""
    total, used = len(symbolic.parents), cliques.used
    base, row_at = used[0], used[1]
    row_pool = grown_ints(cliques.row_pool, row_at, len(symbolic.rows))
    parents = grown_ints(cliques.parents, base, total)
    columns_of = grown_ints(cliques.columns, base, total)
    rows_of = grown_ints(cliques.rows, base, total)
    row_starts = grown_ints(cliques.row_starts, base, total)
    panel_starts = grown_ints(cliques.panel_starts, base, total)
    update_starts = grown_ints(cliques.update_starts, base, total)
    for s in range(total):
        c = base + s
        rows = symbolic.row_starts[s + 1] - symbolic.row_starts[s]
        columns = front_columns(symbolic, s)
        parents[c] = base + symbolic.parents[s] if symbolic.parents[s] >= 0 else -1
        columns_of[c], rows_of[c] = columns, rows
        row_starts[c], panel_starts[c] = row_at, symbolic.panel_starts[s]
        update_starts[c] = panel_starts[c] + rows * columns
        for k in range(rows):
            row_pool[row_at + k] = whole[symbolic.rows[symbolic.row_starts[s] + k]]
            if k < columns:
                clique_of[links.owner[row_pool[row_at + k]]] = c
        row_at += rows
    used[0], used[1], used[2] = base + total, row_at, symbolic.panel_starts[total]
    used[3] = used[0]
    return Cliques(
        parents, columns_of, rows_of, row_starts, panel_starts, update_starts, row_pool,
        cliques.pool, used,
    )  # fmt: skip


@compiled
def _planned(
    cliques: Cliques, links: Links, clique_of: Ints, touched: Ints, is_new: NDArray[np.bool_]
) -> tuple[Ints, Ints, Ints, Symbolic]:
    """Take apart what changed; return its variables, the orphans, and the structure to come.

    The third array says which of the variables each one is; -1: none of them.
    """
    variables, orphans = take_apart(cliques, clique_of, touched, links.owner)
    tidy(cliques, clique_of, orphans, _GAPS, cliques.used[2])
    local = np.full(len(clique_of), -1, np.int64)
    for i in range(len(variables)):
        local[variables[i]] = i
    symbolic = analysed(cliques, links, variables, orphans, local, is_new)
    return variables, orphans, local, _placed(symbolic, cliques.used[2])


@compiled
def _carried_out(
    cliques: Cliques, links: Links, clique_of: Ints, variables: Ints, orphans: Ints, local: Ints,
    symbolic: Symbolic,
) -> tuple[Cliques, int]:  # fmt: skip
    """Eliminate variables as planned; see `renew`."""
    n, pool = len(variables), cliques.pool
    position = np.empty(n + 1, np.int64)
    for k in range(n + 1):
        position[symbolic.order[k]] = k
    column_of, whole = _column_maps(symbolic, links, variables, position)
    homes = _homes(symbolic, cliques, links, orphans, local, position)
    damping = 0.0
    while True:
        assemble(symbolic, links, variables, local, position, pool)
        if damping > 0.0:
            damp(symbolic, n, damping, pool)
        if eliminate_all(symbolic, cliques, orphans, homes, column_of, pool):
            break
        damping = max(1e-9, 100.0 * damping)
        if damping > _MOST_DAMPING:
            return cliques, -1
    base = cliques.used[0]
    for k in range(len(orphans)):
        cliques.parents[orphans[k]] = base + homes[k]
    return _stored(symbolic, cliques, links, clique_of, whole), base


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
    variables, orphans, local, symbolic = _planned(cliques, links, clique_of, touched, is_new)
    pool = with_room(cliques, int(symbolic.panel_starts[-1]))
    renewed, first = _carried_out(cliques, links, clique_of, variables, orphans, local, symbolic)
    return renewed._replace(pool=pool), first
