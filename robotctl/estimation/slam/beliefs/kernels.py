"""The inner loops of Gaussian belief propagation.

A link joins two variables by a Gaussian factor, exp(-d^T H d / 2 + g^T d), with the blocks H
(2, 2, D, D) and g (2, D) of its ends. Message 2 k + s is what link k says to its end 1 - s, once
the variable at its end s is integrated out (Davison and Ortiz, FutureMapping 2, 2019). A belief is
a precision (D, D) and a vector (D,): the sum of what a variable knows alone and of all messages to
it. Variables with fewer than D numbers are padded: precision 1, vector 0.
"""

from __future__ import annotations

from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled

Floats: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int64]

_TINY: Final = 1e-10
"""A pivot below this share of its diagonal is nothing but rounding."""


@compiled
def _solve(A: Floats, b: Floats, spare: Floats) -> None:
    """Solve A X = b in place by Cholesky's method, A (D, D), b (D, columns); A is lost.

    Where A is singular, `spare` (D,) is its pivot: with infinity the solution has a 0 there.
    """
    D = len(A)
    for j in range(D):
        diagonal = A[j, j]
        for k in range(j):
            for i in range(j, D):
                A[i, j] -= A[i, k] * A[j, k]
        root = np.sqrt(A[j, j] if A[j, j] > _TINY * diagonal else spare[j])
        A[j, j] = root
        for i in range(j + 1, D):
            A[i, j] /= root
    for column in range(b.shape[1]):
        for i in range(D):
            for k in range(i):
                b[i, column] -= A[i, k] * b[k, column]
            b[i, column] /= A[i, i]
        for i in range(D - 1, -1, -1):
            for k in range(i + 1, D):
                b[i, column] -= A[k, i] * b[k, column]
            b[i, column] /= A[i, i]


@compiled
def _message(
    H: Floats, g: Floats, s: int, belief: Floats, heard: Floats, nothing: Floats, into: Floats
) -> None:
    """Write the message from end s of a link: its precision and, as the last column, its vector.

    Parameters
    ----------
    H, g
        Of the link.
    belief, heard
        In the variable at the end s, and what the link said to it, (D, D + 1).
    nothing
        Infinity, (D,): what is not known is not told.
    into
        (D, D + 1).
    """
    D, t = len(nothing), 1 - s
    A, b = np.empty((D, D)), np.empty((D, D + 1))
    for i in range(D):
        for j in range(D):
            A[i, j] = H[s, s, i, j] + (belief[i, j] - heard[i, j])
            b[i, j] = H[s, t, i, j]
        b[i, D] = g[s, i] + (belief[i, D] - heard[i, D])
    _solve(A, b, nothing)
    for i in range(D):
        for j in range(D + 1):
            total = g[t, i] if j == D else H[t, t, i, j]
            for k in range(D):
                total -= H[s, t, k, i] * b[k, j]
            into[i, j] = total


@compiled
def _add(a: Floats, b: Floats, factor: float) -> None:
    """Add factor b to a, both (D, D + 1)."""
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            a[i, j] += factor * b[i, j]


@compiled
def send_all(ends: Ints, H: Floats, g: Floats, own: Floats, damping: float, said: Floats) -> None:
    """Send all messages at once.

    Parameters
    ----------
    ends, H, g
        Of the links: (m, 2), (m, 2, 2, D, D) and (m, 2, D).
    own
        What variables know alone, (n, D, D + 1).
    damping
        Share of the old messages that is kept.
    said
        What was said, (2 m, D, D + 1), and then is said now.
    """
    D = own.shape[1]
    beliefs, nothing = own.copy(), np.full(D, np.inf)
    for link in range(len(ends)):
        for s in range(2):
            _add(beliefs[ends[link, 1 - s]], said[2 * link + s], 1.0)
    new = np.empty((2, D, D + 1))
    for link in range(len(ends)):
        for s in range(2):
            heard = said[2 * link + 1 - s]
            _message(H[link], g[link], s, beliefs[ends[link, s]], heard, nothing, new[s])
        for s in range(2):
            _add(new[s], said[2 * link + s], -1.0)
            _add(said[2 * link + s], new[s], 1.0 - damping)


@compiled
def send_by_residual(
    ends: Ints, H: Floats, g: Floats, own: Floats, damping: float, said: Floats, starts: Ints,
    outgoing: Ints, scales: Floats, residuals: Floats,
) -> None:  # fmt: skip
    """Let the variable speak that heard the most since it spoke last, as often as there are some.

    Residual belief propagation (Elidan, McGraw and Koller, UAI 2006) with a priority for each
    variable: the sum of the changes of the messages to it.

    Parameters
    ----------
    ends, H, g, own, damping, said
        As for `send_all`.
    starts, outgoing
        The messages that each variable sends: where they begin, (n + 1,), and all of them.
    scales
        By which changes are judged: the diagonal of the whole matrix, (n, D).
    residuals
        Priorities, (n,); infinite at first. They are changed.
    """
    D = own.shape[1]
    nothing, new, belief = np.full(D, np.inf), np.empty((D, D + 1)), np.empty((D, D + 1))
    for _ in range(len(own)):
        here, left = 0, 0.0
        for i in range(1, len(residuals)):
            if residuals[i] > residuals[here]:
                here = i
        belief[:] = 0.0
        _add(belief, own[here], 1.0)
        for at in range(starts[here], starts[here + 1]):
            _add(belief, said[outgoing[at] ^ 1], 1.0)
        for at in range(starts[here], starts[here + 1]):
            out = outgoing[at]
            link, s, change = out >> 1, out & 1, 0.0
            there = ends[link, 1 - s]
            _message(H[link], g[link], s, belief, said[out ^ 1], nothing, new)
            _add(new, said[out], -1.0)
            for i in range(D):
                change = max(change, abs(new[i, i]) / scales[there, i])
                change = max(change, abs(new[i, D]) / np.sqrt(scales[there, i]))
            _add(said[out], new, 1.0 - damping)
            residuals[there] += (1.0 - damping) * change
            left = max(left, damping * change)
        residuals[here] = left


@compiled
def gather(
    children: Ints, links: Ints, roots: Ints, ends: Ints, H: Floats, precisions: Floats,
    spare: Floats, inverses: Floats, gains: Floats,
) -> None:  # fmt: skip
    """Send the precisions of a forest to its roots.

    Parameters
    ----------
    children, links
        Variables and their messages to their parents, those near the roots first, (m,).
    roots
        All other variables.
    ends, H, precisions
        Of the graph.
    spare
        Precision of what the forest leaves open, (n, D), see `_solve`.
    inverses, gains
        Are filled: the covariance of each variable given its parent, (n, D, D), and by how much its
        mean follows that of the parent, less: (n, D, D).
    """
    D = spare.shape[1]
    P, A, b = precisions.copy(), np.empty((D, D)), np.empty((D, 2 * D))
    for k in range(len(children) - 1, -1, -1):
        here, link, s = children[k], links[k] >> 1, links[k] & 1
        there = ends[link, 1 - s]
        for i in range(D):
            for j in range(D):
                A[i, j] = P[here, i, j] + H[link, s, s, i, j]
                b[i, j] = H[link, s, 1 - s, i, j]
                b[i, D + j] = 1.0 if i == j else 0.0
        _solve(A, b, spare[here])
        for i in range(D):
            for j in range(D):
                gains[here, i, j], inverses[here, i, j] = b[i, j], b[i, D + j]
                total = H[link, 1 - s, 1 - s, i, j]
                for m in range(D):
                    total -= H[link, s, 1 - s, m, i] * b[m, j]
                P[there, i, j] += total
    for here in roots:
        inverses[here] = 0.0
        for i in range(D):
            inverses[here, i, i] = 1.0
        _solve(P[here], inverses[here], spare[here])


@compiled
def tree_means(
    children: Ints, parents: Ints, roots: Ints, inverses: Floats, gains: Floats, vectors: Floats
) -> Floats:
    """Return the exact means on a forest for vectors (n, D): once to the roots and back.

    The links' own vectors are part of `vectors`; the rest is as for `gather`.
    """
    D = vectors.shape[1]
    v, means = vectors.copy(), np.zeros_like(vectors)
    for k in range(len(children) - 1, -1, -1):
        here, there = children[k], parents[k]
        for i in range(D):
            for j in range(D):
                v[there, i] -= gains[here, j, i] * v[here, j]
    for here in roots:
        for i in range(D):
            for j in range(D):
                means[here, i] += inverses[here, i, j] * v[here, j]
    for k in range(len(children)):
        here, there = children[k], parents[k]
        for i in range(D):
            for j in range(D):
                means[here, i] += inverses[here, i, j] * v[here, j]
                means[here, i] -= gains[here, i, j] * means[there, j]
    return means


@compiled
def product(ends: Ints, H: Floats, precisions: Floats, x: Floats) -> Floats:
    """Return the whole matrix times x, (n, D): each variable asks its neighbours once."""
    n, D = x.shape
    result = np.zeros_like(x)
    for here in range(n):
        for i in range(D):
            for j in range(D):
                result[here, i] += precisions[here, i, j] * x[here, j]
    for link in range(len(ends)):
        a, b = ends[link]
        for i in range(D):
            for j in range(D):
                result[a, i] += H[link, 0, 0, i, j] * x[a, j] + H[link, 0, 1, i, j] * x[b, j]
                result[b, i] += H[link, 1, 0, i, j] * x[a, j] + H[link, 1, 1, i, j] * x[b, j]
    return result
