"""Cliques of a Bayes tree that new factors reach, taken apart, and an order to eliminate them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.estimation.slam.incremental.bayes_tree import Cliques, Ints, Links, grown_ints
from robotctl.estimation.slam.linear.ordering import minimum_degree
from robotctl.estimation.slam.linear.symbolic import Symbolic, analyse


@compiled
def take_apart(cliques: Cliques, clique_of: Ints, touched: Ints, owner: Ints) -> tuple[Ints, Ints]:  # noqa: C901 - one compiled loop
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
    _give_back(cliques)
    return variables[:found], orphans[:cut]


@compiled
def _give_back(cliques: Cliques) -> None:
    """Free the space of the last cliques if they are gone: most are, as the root came last."""
    used = cliques.used
    while used[0] > 0 and cliques.parents[used[0] - 1] == -2:
        used[0] -= 1
        used[1] = cliques.row_starts[used[0]]
        used[2] = cliques.panel_starts[used[0]]


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
            factor = links.factor_of[entry]
            for other in range(links.begins[factor], links.begins[factor + 1]):
                j = local[links.ends[other]]
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
def analysed(
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
