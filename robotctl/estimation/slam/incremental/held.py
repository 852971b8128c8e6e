"""Factors that a Bayes tree has not taken in yet: their part in the solution, without a new tree.

Where cliques have hundreds of rows, eliminating them again for one loop takes far longer than
solving with them. A new variable is hung to the tree as a leaf by a factor that says nothing about
anything else; B d + b, the whitened residuals of the other new factors, are held. With the tree's
information A = L L^T, its eliminated gradient p = L^-1 g and Y = L^-1 B^T, the solution of
(A + B^T B) d = -(g + B^T b) is that of L^T d = -(p + Y q), with (I + Y^T Y) q = b - Y^T p
(Woodbury's formula). Y has entries only on the paths from the factors' variables to the root.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from native_kernels.compiled import compiled
from robotctl.estimation.grown import Grown
from robotctl.estimation.slam.incremental.bayes_tree import (
    Cliques,
    Floats,
    Ints,
    Links,
    columns_of,
    grown_ints,
    packed,
    with_room,
)
from robotctl.estimation.slam.incremental.sweeps import paths_up, sweep_up
from robotctl.estimation.slam.linear.cholesky import SMALLEST, eliminate

_MOST: Final = 128
"""Rows of B that are held; more, and the tree is renewed."""
_NOTHING: Final = 1e-8
"""Share of a factor's information about other variables that may be left when one is eliminated."""


@compiled
def work_of(cliques: Cliques, clique_of: Ints, variables: Ints) -> float:
    """Return how many products it takes to eliminate again what some variables reach."""
    is_on_path, total = paths_up(cliques, clique_of, variables), 0.0
    for c in range(cliques.used[0]):
        if is_on_path[c]:
            total += float(cliques.columns[c]) * float(cliques.rows[c]) ** 2
    return total


@compiled
def _hung(  # noqa: C901 - one compiled loop
    cliques: Cliques, links: Links, clique_of: Ints, variable: int, factor: int
) -> tuple[Cliques, bool]:
    """Hang a new variable to the tree; see `hang`."""
    own, width, skip, other, far = links.dof[variable], 0, 0, -1, 0
    for entry in range(links.begins[factor], links.begins[factor + 1]):
        v = links.ends[entry]
        if v == variable:
            skip = width
        elif other >= 0 or clique_of[v] < 0:
            return cliques, False
        else:
            other, far = v, width
        width += links.dof[v]
    place = np.empty(width + 1, np.int64)  # in the factor's terms, of each row of the front
    for k in range(own):
        place[k] = skip + k
    for k in range(width - own):
        place[own + k] = far + k
    rows, size, at = width + 1, width + 1 - own, links.places[factor]
    panel, update, before = np.zeros(rows * own), np.zeros(size * size), np.zeros(size)
    for j in range(width):
        for i in range(j, width):
            value = links.terms[at + place[j] * width + place[i]]
            if j < own:
                panel[j * rows + i] = value
            else:
                update[(j - own) * size + i - own] = value
        value = links.terms[at + width * width + place[j]]
        if j < own:
            panel[j * rows + width] = value
        else:
            update[(j - own) * size + width - own] = value
    for j in range(size - 1):
        before[j] = update[j * size + j]
    if eliminate(panel, rows, own, update) >= 0:
        return cliques, False
    for j in range(size - 1):
        if not abs(update[j * size + j]) <= _NOTHING * before[j]:
            return cliques, False
    used = cliques.used
    c, row_at, panel_at = used[0], used[1], used[2]
    room = rows * own + packed(size)
    tree = Cliques(
        grown_ints(cliques.parents, c, 1), grown_ints(cliques.columns, c, 1),
        grown_ints(cliques.rows, c, 1), grown_ints(cliques.row_starts, c, 1),
        grown_ints(cliques.panel_starts, c, 1), grown_ints(cliques.update_starts, c, 1),
        grown_ints(cliques.row_pool, row_at, rows), cliques.pool, used,
    )  # fmt: skip
    tree.parents[c] = clique_of[other] if other >= 0 else used[3] - 1
    tree.columns[c], tree.rows[c] = own, rows
    tree.row_starts[c], tree.panel_starts[c] = row_at, panel_at
    tree.update_starts[c] = panel_at + rows * own
    for k in range(own):
        tree.row_pool[row_at + k] = links.offsets[variable] + k
    for k in range(width - own):
        tree.row_pool[row_at + own + k] = links.offsets[other] + k
    tree.row_pool[row_at + width] = -1
    tree.pool[panel_at : panel_at + rows * own] = panel
    tree.pool[panel_at + rows * own : panel_at + room] = 0.0
    used[0], used[1], used[2] = c + 1, row_at + rows, panel_at + room
    clique_of[variable] = c
    return tree, True


def hang(
    cliques: Cliques, links: Links, clique_of: Ints, variable: int, factor: int
) -> tuple[Cliques, bool]:
    """Hang a new variable to the tree, by a factor that determines it and says nothing else.

    Returns
    -------
    cliques : Cliques
        The tree; its arrays may be other ones.
    is_done : bool
        False where the factor links more than one variable of the tree, or says more.
    """
    begin, end = links.begins[factor : factor + 2]
    width = int(links.dof[links.ends[begin:end]].sum())
    pool = with_room(cliques, int(cliques.used[2]) + 2 * (width + 1) ** 2)
    hung, is_done = _hung(cliques, links, clique_of, variable, factor)
    return hung._replace(pool=pool), is_done


@compiled
def whitened(terms: Floats, width: int) -> tuple[Floats, Floats]:
    """Return B (rank, width) and b (rank,) of a factor's matrix B^T B and gradient B^T b.

    Cholesky's factor, the largest pivot first, by how much of it is left.
    """
    H = terms[: width * width].reshape(width, width).copy()
    g = terms[width * width : width * width + width].copy()
    before, B, b, rank = np.diag(H).copy(), np.empty((width, width)), np.empty(width), 0
    while rank < width:
        best, pivot = SMALLEST, -1
        for k in range(width):
            if H[k, k] > best * before[k]:
                best, pivot = H[k, k] / before[k], k
        if pivot < 0:
            break
        root = np.sqrt(H[pivot, pivot])
        B[rank] = H[pivot] / root
        b[rank] = g[pivot] / root
        for i in range(width):
            g[i] -= B[rank, i] * b[rank]
            for j in range(width):
                H[i, j] -= B[rank, i] * B[rank, j]
        H[pivot, pivot] = 0.0
        rank += 1
    return B[:rank], b[:rank]


@compiled
def equations(links: Links, factors: Ints) -> tuple[Ints, Floats, Floats]:
    """Return the free variables of factors, B (rows, their columns), and b (rows,)."""
    entries, width = 0, 0
    for factor in factors:
        for entry in range(links.begins[factor], links.begins[factor + 1]):
            entries += 1
            width += links.dof[links.ends[entry]]
    variables, B, b = np.empty(entries, np.int64), np.zeros((width, width)), np.empty(width)
    entries, width, rows = 0, 0, 0
    for factor in factors:
        begin = width
        for entry in range(links.begins[factor], links.begins[factor + 1]):
            variables[entries] = links.ends[entry]
            width += links.dof[links.ends[entry]]
            entries += 1
        own, right = whitened(links.terms[links.places[factor] :], width - begin)
        for i in range(len(right)):
            for j in range(width - begin):
                B[rows, begin + j] = own[i, j]
            b[rows] = right[i]
            rows += 1
    return variables, B[:rows], b[:rows]


@compiled
def _join(
    own: Floats, places: Ints, p: Floats, begin: int, Y: Floats, L: Floats, z: Floats
) -> None:
    """Append columns to Y, and rows to the factor of I + Y^T Y and to the solution with it.

    Parameters
    ----------
    own, places
        Columns (k, m), and the rows of Y that they stand in.
    p
        Of these rows, (k,).
    begin
        Columns that Y had before.
    Y, L, z
        Changed. L L^T = I + Y^T Y, and L z = b - Y^T p; of z, b is there for the new rows.
    """
    m = own.shape[1]
    L[begin : begin + m, : begin + m] = 0.0
    for k in range(len(places)):
        row = Y[places[k]]
        for i in range(m):
            row[begin + i] = own[k, i]
        for i in range(m):
            y = own[k, i]
            z[begin + i] -= y * p[k]
            products = L[begin + i]
            for j in range(begin + i + 1):
                products[j] += y * row[j]
    for i in range(begin, begin + m):
        L[i, i] += 1.0
        for j in range(i + 1):
            total = L[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            L[i, j] = np.sqrt(total) if i == j else total / L[j, j]
        for j in range(i):
            z[i] -= L[i, j] * z[j]
        z[i] /= L[i, i]


@compiled
def _shifted(Y: Floats, columns: Ints, L: Floats, z: Floats, size: int) -> Floats:
    """Return Y q at its columns among all, (size,), with L^T q = z."""
    n = len(z)
    q, result = z.copy(), np.zeros(size)
    for i in range(n - 1, -1, -1):
        q[i] /= L[i, i]
        for j in range(i):
            q[j] -= L[i, j] * q[i]
    for k in range(len(columns)):
        total = 0.0
        for i in range(n):
            total += Y[k, i] * q[i]
        result[columns[k]] = total
    return result


@compiled
def _known(Y: Floats, places: Ints, own: Floats, L: Floats, n: int) -> Floats:
    """Return C^T (L L^T)^-1 C (m, m), with C = Y^T `own`, whose rows (k, m) stand at `places`."""
    m = own.shape[1]
    C, result = np.zeros((n, m)), np.zeros((m, m))
    for k in range(len(places)):
        if places[k] >= 0:
            for i in range(n):
                for j in range(m):
                    C[i, j] += Y[places[k], i] * own[k, j]
    for i in range(n):
        for j in range(m):
            for k in range(i):
                C[i, j] -= L[i, k] * C[k, j]
            C[i, j] /= L[i, i]
        for j in range(m):
            for k in range(m):
                result[j, k] += C[i, j] * C[i, k]
    return result


class Held:
    """The factors that are held since the tree was renewed."""

    def __init__(self) -> None:
        self.touched: list[int] = []
        """Variables of what was hung and held."""
        self._count = 0
        self._local = Grown((), np.int64)
        self._columns = Grown((), np.int64)
        self._Y = Grown((_MOST,), float)
        self._L, self._z = np.zeros((_MOST, _MOST)), np.zeros(_MOST)

    def has_room(self, rows: int) -> bool:
        """Return whether that many rows may come."""
        return self._count + rows <= _MOST

    def add(self, cliques: Cliques, links: Links, clique_of: Ints, factors: Ints) -> None:
        """Hold factors, all of whose variables are in the tree."""
        size, begin = len(links.owner), self._count
        variables, B, b = equations(links, factors)
        columns = columns_of(links.offsets, links.dof, variables)
        reached, own, p = sweep_up(cliques, clique_of, variables, columns, B, size)
        self._local.add(np.full(size - self._local.size, -1))
        fresh = reached[self._local.array[reached] < 0]
        self._local.array[fresh] = self._columns.add(fresh) + np.arange(len(fresh))
        self._Y.add(np.zeros((len(fresh), _MOST)))
        self._count += len(b)
        self._z[begin : self._count] = b
        places = self._local.array[reached]
        _join(own, places, p, begin, self._Y.array, self._L, self._z)

    def shift(self, size: int) -> Floats:
        """Return Y q, what held factors add to the eliminated gradient of all columns (size,)."""
        n = self._count
        return _shifted(self._Y.view, self._columns.view, self._L, self._z[:n], size)

    def known(self, reached: Ints, Y: Floats) -> Floats:
        """Return how much less the covariance Y^T Y is by the held factors, (m, m).

        Parameters
        ----------
        reached, Y
            As of `sweep_up`.
        """
        if not self._count:
            return np.zeros((Y.shape[1], Y.shape[1]))
        # Columns of what was hung later are not among them.
        self._local.add(np.full(max(0, int(reached.max()) + 1 - self._local.size), -1))
        return _known(self._Y.array, self._local.array[reached], Y, self._L, self._count)
