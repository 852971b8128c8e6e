"""Inner loops of EKF-SLAM on a covariance of which each block is kept once.

`P` is one flat array: first P_xx of the robot, (nv, nv), then a panel for each feature f, (2,
nv + 2 f + 2): the blocks of its rows up to the diagonal, P_yx, P_yy0, ... P_yy. A new feature is a
panel more and moves nothing, an update reads and writes half of the matrix in the order of its
addresses, and no loop copies it.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.compiled import compiled

Array: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.int64]


@compiled
def panel_start(nv: int, f: int) -> int:
    """Return where the panel of a feature begins in `P`."""
    return nv * nv + 2 * f * (nv + f + 1)


@compiled
def _panel(P: Array, nv: int, f: int) -> Array:
    """Return the panel of a feature, a view (2, nv + 2 f + 2)."""
    length = nv + 2 * f + 2
    start = panel_start(nv, f)
    return P[start : start + 2 * length].reshape(2, length)


@compiled
def predict(P: Array, count: int, nv: int, F: Array, Q: Array) -> None:
    """Move the robot: P_xx = F P_xx F' + Q and P_yx = P_yx F'; features among themselves stay.

    Parameters
    ----------
    count
        How many features there are.
    F, Q
        Jacobian of the motion by the robot's state, and its noise, (nv, nv).
    """
    own = P[: nv * nv].reshape(nv, nv)
    half = F @ own
    for i in range(nv):
        for j in range(i, nv):
            total = Q[i, j]
            for k in range(nv):
                total += half[i, k] * F[j, k]
            own[i, j] = total
            own[j, i] = total
    moved = np.empty(nv)
    for f in range(count):
        panel = _panel(P, nv, f)
        for r in range(2):
            for i in range(nv):
                total = 0.0
                for k in range(nv):
                    total += panel[r, k] * F[i, k]
                moved[i] = total
            for i in range(nv):
                panel[r, i] = moved[i]


@compiled
def _project(P: Array, count: int, nv: int, f: int, Hv: Array, Hf: Array, out: Array) -> None:
    """Write H P of a measurement of a feature into `out`, (2, n or more)."""
    mine = _panel(P, nv, f)
    for r in range(2):
        to = out[r, : nv + 2 * f]
        u, v, first, second = Hf[r, 0], Hf[r, 1], mine[0], mine[1]
        for i in range(nv + 2 * f):
            to[i] = u * first[i] + v * second[i]
        for i in range(nv):
            for k in range(nv):
                to[i] += Hv[r, k] * P[i * nv + k]
    a, b, c, d = Hf[0, 0], Hf[0, 1], Hf[1, 0], Hf[1, 1]
    at = nv + 2 * f
    row = nv * nv
    for i in range(nv, nv + 2 * count):
        u, v = 0.0, 0.0
        if i < at:
            u, v = out[0, i], out[1, i]
        else:
            first, second = P[row + at], P[row + at + 1]
            u, v = a * first + b * second, c * first + d * second
        for k in range(nv):
            share = P[row + k]
            u += Hv[0, k] * share
            v += Hv[1, k] * share
        out[0, i], out[1, i] = u, v
        row += i + 2 - (i - nv) % 2


@compiled
def update(  # noqa: C901 - one loop nest
    x: Array,
    P: Array,
    count: int,
    nv: int,
    which: Indices,
    Hv: Array,
    Hf: Array,
    innovations: Array,
    R: Array,
    W: Array,
    turns: NDArray[np.bool_],
) -> float:
    """Correct `x` and `P` by m measurements of features jointly; return their joint NIS.

    With S = H P H' + R = L L' and W = L^-1 H P the new covariance is P - W' W, which stays
    symmetric by construction, and the correction of the state is W' L^-1 times the innovation.

    Parameters
    ----------
    which
        The features, (m,).
    Hv, Hf
        Jacobians by robot and by the measured feature, (m, 2, nv) and (m, 2, 2).
    innovations, R
        Measured minus expected, (m, 2), and the noises of the measurements, (m, 2, 2).
    W
        Working memory, (2, 2 m + 2 or more, n or more).
    turns
        Which features, (count,), and at last the robot, turn with the heading (see `_turn`); (0,)
        without this.

    Returns
    -------
    nan if S is not positive definite; nothing is changed then.
    """
    m, n = len(which), nv + 2 * count
    A, B = W[0], W[1]
    for a in range(m):
        _project(P, count, nv, which[a], Hv[a], Hf[a], A[2 * a : 2 * a + 2])
    L, y = np.empty((2 * m, 2 * m)), np.empty(2 * m)
    nis = 0.0
    for a in range(2 * m):
        y[a] = innovations[a // 2, a % 2]
        for b in range(a + 1):
            to, r = b // 2, b % 2
            at = nv + 2 * which[to]
            total = A[a, at] * Hf[to, r, 0] + A[a, at + 1] * Hf[to, r, 1]
            if a // 2 == to:
                total += R[to, a % 2, r]
            for k in range(nv):
                total += A[a, k] * Hv[to, r, k]
            for k in range(b):
                total -= L[a, k] * L[b, k]
            if a > b:
                L[a, b] = total / L[b, b]
                y[a] -= L[a, b] * y[b]
            elif total > 0.0:
                L[a, a] = math.sqrt(total)
            else:
                return math.nan
        y[a] /= L[a, a]
        nis += y[a] * y[a]
    for a in range(2 * m):
        row, same = A[a, :n], B[a, :n]
        for k in range(a):
            share, other = L[a, k], A[k, :n]
            for j in range(n):
                row[j] -= share * other[j]
        scale = 1.0 / L[a, a]
        for j in range(n):
            row[j] *= scale
            same[j] = row[j]
    change = B[2 * m, :n]
    change[:] = 0.0
    for a in range(2 * m):
        step, row = y[a], A[a, :n]
        for j in range(n):
            change[j] += step * row[j]
    pairs = m
    if len(turns):
        _turn(x, P, count, nv, A, B, m, turns)
        pairs = m + 1
    else:
        for j in range(n):
            x[j] += change[j]
    _subtract(P, count, nv, A, B, pairs)
    return nis


@compiled
def _subtract(P: Array, count: int, nv: int, A: Array, B: Array, pairs: int) -> None:
    """Subtract A' B: one pass, two rows of the covariance and two of A and B at a time."""
    for i in range(nv):
        for j in range(nv):
            for a in range(2 * pairs):
                P[i * nv + j] -= A[a, i] * B[a, j]
    start = nv * nv
    for f in range(count):
        i = nv + 2 * f
        length = i + 2
        upper = P[start : start + length]
        lower = P[start + length : start + 2 * length]
        start += 2 * length
        for a in range(pairs):
            u0, v0, u1, v1 = A[2 * a, i], A[2 * a + 1, i], A[2 * a, i + 1], A[2 * a + 1, i + 1]
            first, second = B[2 * a, :length], B[2 * a + 1, :length]
            for j in range(length):
                p, q = first[j], second[j]
                upper[j] -= u0 * p + v0 * q
                lower[j] -= u1 * p + v1 * q


@compiled
def _turn(
    x: Array, P: Array, count: int, nv: int, A: Array, B: Array, m: int, turns: NDArray[np.bool_]
) -> None:
    """Correct `x` as errors that turn with the heading have it, and prepare the same for `P`.

    A correction by dp and dtheta moves a point by V(dtheta) dp, the exponential of SE(2). The
    errors that the covariance is of then are those at the new estimate: M P M', where M adds
    J Delta times the error of the heading to the error of a point that moved by Delta. That is
    P + u v' + v u' with u = J Delta, and v the heading's row and half its variance times u.
    """
    n = nv + 2 * count
    change, u, v = B[2 * m, :n].copy(), A[2 * m, :n], A[2 * m + 1, :n]
    turned = change[2]
    half = 0.5 * turned
    sinc = math.sin(half) / half if abs(half) > 1e-8 else 1.0
    c, s = sinc * math.cos(half), sinc * math.sin(half)
    u[:] = 0.0
    for f in range(-1, count):
        at = 0 if f < 0 else nv + 2 * f
        if turns[f]:
            dx, dy = change[at], change[at + 1]
            change[at], change[at + 1] = c * dx - s * dy, s * dx + c * dy
            u[at], u[at + 1] = -change[at + 1], change[at]
    start = nv * nv
    for j in range(n):
        x[j] += change[j]
        if j < nv:
            v[j] = P[j * nv + 2]
        else:
            v[j] = P[start + 2]
            start += j + 2 - (j - nv) % 2
        for a in range(2 * m):
            v[j] -= B[a, 2] * B[a, j]
    variance = 0.5 * v[2]
    for j in range(n):
        v[j] += variance * u[j]
        B[2 * m, j], B[2 * m + 1, j] = -v[j], -u[j]


@compiled
def append(P: Array, count: int, nv: int, Gv: Array, noise: Array) -> None:
    """Add the panel of a new feature, number `count`.

    Parameters
    ----------
    Gv, noise
        Its Jacobian by the robot's state, (2, nv), and its covariance given that state, (2, 2).
    """
    own = P[: nv * nv].reshape(nv, nv)
    new = _panel(P, nv, count)
    for r in range(2):
        for j in range(nv):
            total = 0.0
            for k in range(nv):
                total += Gv[r, k] * own[k, j]
            new[r, j] = total
        for g in range(count):
            panel = _panel(P, nv, g)
            for q in range(2):
                total = 0.0
                for k in range(nv):
                    total += Gv[r, k] * panel[q, k]
                new[r, nv + 2 * g + q] = total
    at = nv + 2 * count
    for r in range(2):
        for q in range(2):
            total = 0.5 * (noise[r, q] + noise[q, r])
            for k in range(nv):
                total += new[r, k] * Gv[q, k]
            new[r, at + q] = total
    new[1, at] = new[0, at + 1]


@compiled
def remove(P: Array, count: int, nv: int, f: int) -> None:
    """Take out the rows and columns of a feature; those behind it move up."""
    for g in range(f, count - 1):
        source, to = _panel(P, nv, g + 1), _panel(P, nv, g)
        length = nv + 2 * g + 2
        for r in range(2):  # what is written lies before what is still to be read
            for j in range(nv + 2 * f):
                to[r, j] = source[r, j]
            for j in range(nv + 2 * f, length):
                to[r, j] = source[r, j + 2]


@compiled
def dense(P: Array, count: int, nv: int) -> Array:
    """Return the whole covariance (n, n)."""
    n = nv + 2 * count
    found = np.empty((n, n))
    found[:nv, :nv] = P[: nv * nv].reshape(nv, nv)
    for f in range(count):
        panel = _panel(P, nv, f)
        for r in range(2):
            for j in range(nv + 2 * f + 2):
                found[nv + 2 * f + r, j] = panel[r, j]
                found[j, nv + 2 * f + r] = panel[r, j]
    return found


@compiled
def innovation_covariance(  # noqa: C901 - one loop nest
    P: Array, nv: int, firsts: Indices, seconds: Indices, Hv: Array, Hf: Array, which: Indices
) -> Array:
    """Return H_a P H_b' of pairs of measurements, without their noise, (pairs, 2, 2).

    Parameters
    ----------
    firsts, seconds
        The measurements a and b of each pair, (pairs,).
    Hv, Hf, which
        Of m measurements, as of `update`.
    """
    own = P[: nv * nv].reshape(nv, nv)
    found = np.empty((len(firsts), 2, 2))
    half = np.empty((2, nv + 2))
    for pair in range(len(firsts)):
        a, b = firsts[pair], seconds[pair]
        f, g = which[a], which[b]
        mine, other = _panel(P, nv, f), _panel(P, nv, g)
        for r in range(2):  # H_a P at the columns of the robot, then of the other feature
            for j in range(nv):
                total = Hf[a, r, 0] * mine[0, j] + Hf[a, r, 1] * mine[1, j]
                for k in range(nv):
                    total += Hv[a, r, k] * own[k, j]
                half[r, j] = total
            for q in range(2):
                total = 0.0
                for k in range(nv):
                    total += Hv[a, r, k] * other[q, k]
                for k in range(2):
                    if f >= g:
                        total += Hf[a, r, k] * mine[k, nv + 2 * g + q]
                    else:
                        total += Hf[a, r, k] * other[q, nv + 2 * f + k]
                half[r, nv + q] = total
        for r in range(2):
            for q in range(2):
                total = half[r, nv] * Hf[b, q, 0] + half[r, nv + 1] * Hf[b, q, 1]
                for k in range(nv):
                    total += half[r, k] * Hv[b, q, k]
                found[pair, r, q] = total
    return found
