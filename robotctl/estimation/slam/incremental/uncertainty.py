"""How well a Bayes tree knows what a factor says, without the covariance of anything else.

With the factor L L^T of the information and a Jacobian J, the covariance of J x is Y^T Y with
L Y = J^T. Elimination only passes on what it finds to the root: forward substitution touches the
cliques from the variables of the factor up to the root, and no others (Kaess, Dellaert,
Covariance recovery from a square root information matrix for data association, RAS 57, 2009).
"""

from __future__ import annotations

import numpy as np

from robotctl.compiled import compiled
from robotctl.estimation.slam.incremental.bayes_tree import Cliques, Floats, Ints


@compiled
def projected_covariance(  # noqa: C901 - one compiled loop
    cliques: Cliques, clique_of: Ints, variables: Ints, columns: Ints, jacobian: Floats, size: int
) -> Floats:
    """Return J P J^T, (m, m).

    Parameters
    ----------
    cliques, clique_of
        The tree, and the clique in which each variable is eliminated.
    variables
        Whose columns are meant; only free ones, that are in the tree.
    columns, jacobian
        Columns of the whole system (n,), and J over them, (m, n).
    size
        Columns of the whole system.
    """
    m = len(jacobian)
    is_on_path = np.zeros(cliques.used[0], np.bool_)
    for v in variables:
        c = clique_of[v]
        while c >= 0 and not is_on_path[c]:
            is_on_path[c] = True
            c = cliques.parents[c]
    right = np.zeros((size, m))
    for k in range(len(columns)):
        for i in range(m):
            right[columns[k], i] += jacobian[i, k]
    result = np.zeros((m, m))
    y = np.empty(m)
    for c in range(cliques.used[0]):
        if not is_on_path[c]:
            continue
        rows, begin = cliques.rows[c], cliques.row_starts[c]
        for j in range(cliques.columns[c]):
            column = cliques.panel_starts[c] + j * rows
            at = cliques.row_pool[begin + j]
            for i in range(m):
                y[i] = right[at, i] / cliques.pool[column + j]
            for k in range(j + 1, rows - 1):
                factor = cliques.pool[column + k]
                below = cliques.row_pool[begin + k]
                for i in range(m):
                    right[below, i] -= factor * y[i]
            for i in range(m):
                for k in range(m):
                    result[i, k] += y[i] * y[k]
    return result
