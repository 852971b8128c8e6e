"""Gaussian whose state grows and shrinks: the core of the filters that map.

    gaussian = GrowingGaussian(x_v, P_xx)              # the robot
    gaussian.predict(x_v, F, Q)
    at = gaussian.append(y, columns, J, noise)         # a feature: error J e[columns] plus noise
    gaussian.update(columns, J, innovations, R)
    gaussian.remove(at, len(y))

A measurement names the columns of the state on which it depends, so an update costs one pass over
the covariance. Only its lower triangle is stored, row after row in one array: a new state is a row
more and moves nothing.
"""

from __future__ import annotations

import math
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled

Array: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.int64]

HEADING: Final = 2
"""Column of the robot's heading, with which positions turn."""
_NO_PLACES: Final = np.empty(0, np.int64)


class GrowingGaussian:
    """Mean and covariance of a state that grows and shrinks.

    Parameters
    ----------
    x, P
        Mean (n,) and covariance (n, n) at the start.
    """

    def __init__(self, x: Array, P: Array) -> None:
        self.n = len(x)
        """Size of the state."""
        self._x = np.array(x, np.float64)
        self.x = self._x
        """The mean (n,), a view."""
        self._P = P[np.tril_indices(self.n)].astype(np.float64)
        self._W = np.empty((2, 4, self.n))

    def covariance(self) -> Array:
        """Return a copy of the covariance (n, n)."""
        return self.block(np.arange(self.n))

    def block(self, rows: Indices, columns: Indices | None = None) -> Array:
        """Return a copy of a block of the covariance; without columns, those of the rows.

        Raises
        ------
        IndexError
            If the state has no such row or column.
        """
        columns = rows if columns is None else columns
        for each in (rows, columns):
            if len(each) and not 0 <= each.min() <= each.max() < self.n:
                raise IndexError(f"columns {each.min()} to {each.max()}: there are {self.n}")
        result: Array = self._P[_places(rows, columns)]
        return result

    def set_block(self, rows: Indices, P: Array) -> None:
        """Replace the covariance of some states among themselves by P, symmetric."""
        self._P[_places(rows, rows)] = P

    def predict(self, x_v: Array, F: Array, Q: Array) -> None:
        """Move the first states to `x_v`; only their own rows and columns change.

        Parameters
        ----------
        F, Q
            Jacobian of the new first states by the old ones, and the noise of the motion, (nv, nv).
        """
        _predict(self._P, self.n, F, Q)
        self.x[: len(x_v)] = x_v

    def update(
        self,
        columns: Indices,
        J: Array,
        innovations: Array,
        R: Array,
        turning: Indices = _NO_PLACES,
    ) -> float:
        """Correct the state by m measurements of size d jointly; return their NIS.

        Parameters
        ----------
        columns, J
            Columns of the state on which each depends (m, k), and Jacobians by these (m, d, k).
        innovations, R
            Measured minus expected (m, d), and noises of the measurements (m, d, d).
        turning
            First columns of the positions (x, y) whose errors turn with that of the heading.

        Raises
        ------
        ValueError
            If the innovations have no positive definite covariance; nothing has changed then.
        """
        rows = J.shape[0] * J.shape[1]
        if self._W.shape[1] < rows + 3 or self._W.shape[2] < self.n:
            self._W = np.empty((2, rows + 3, len(self._x)))
        nis = _update(self.x, self._P, self.n, columns, J, innovations, R, self._W, turning)
        if nis != nis:  # noqa: PLR0124 - nan
            raise ValueError("the covariance of the innovations is not positive definite")
        return nis

    def append(self, y: Array, columns: Indices, J: Array, noise: Array) -> int:
        """Add states at the end; return the first of their columns.

        Parameters
        ----------
        y
            Their mean (w,).
        columns, J
            Columns on which they depend (k,), and Jacobian by these (w, k).
        noise
            Their covariance given these columns, (w, w).
        """
        first, n = self.n, self.n + len(y)
        if n > len(self._x):
            self._reserve(2 * n)
        _append(self._P, first, columns, J, noise)
        self._x[first:n] = y
        self.n, self.x = n, self._x[:n]
        return first

    def remove(self, first: int, width: int) -> None:
        """Forget `width` states from column `first` on; the last `width` take their place."""
        last = self.n - width
        _remove(self._P, self.n, first, width)
        self.x[first : first + width] = self.x[last:].copy()
        self.n, self.x = last, self._x[:last]

    def innovation_covariances(self, columns: Indices, J: Array) -> Array:
        """Return J P J' of each of m measurements, without their noise, (m, d, d)."""
        each = np.arange(len(columns))
        return _innovation_covariances(self._P, each, each, columns, J)

    def joint_innovation_covariance(self, columns: Indices, J: Array) -> Array:
        """Return J P J' of m measurements together, without their noise, (m d, m d)."""
        m, d, _ = J.shape
        a, b = (each.ravel() for each in np.indices((m, m)))
        found = _innovation_covariances(self._P, a, b, columns, J)
        return found.reshape(m, m, d, d).transpose(0, 2, 1, 3).reshape(m * d, m * d)

    def _reserve(self, n: int) -> None:
        """Make room for n states; as the room doubles, it is seldom."""
        x, P = np.zeros(n), np.zeros(n * (n + 1) // 2)
        x[: self.n] = self.x
        P[: self.n * (self.n + 1) // 2] = self._P[: self.n * (self.n + 1) // 2]
        self._x, self._P = x, P


def _places(rows: Indices, columns: Indices) -> Indices:
    """Return where the entries of a block are stored, (rows, columns)."""
    low = np.minimum(rows[:, np.newaxis], columns)
    high = np.maximum(rows[:, np.newaxis], columns)
    result: Indices = high * (high + 1) // 2 + low
    return result


@compiled
def _row(i: int) -> int:
    """Return where row i of the triangle begins."""
    return i * (i + 1) // 2


@compiled
def _entry(P: Array, i: int, j: int) -> float:
    """Return entry (i, j) of the covariance."""
    found: float = P[_row(i) + j] if i >= j else P[_row(j) + i]
    return found


@compiled
def _read_column(P: Array, n: int, column: int, out: Array) -> None:
    """Write a column of the covariance into `out`, (n or more,)."""
    at = _row(column)
    for j in range(column + 1):
        out[j] = P[at + j]
    at += 2 * column + 1
    for j in range(column + 1, n):
        out[j] = P[at]
        at += j + 1


@compiled
def _predict(P: Array, n: int, F: Array, Q: Array) -> None:
    """Move the first states: P_vv = F P_vv F' + Q, P_yv = P_yv F'; the others stay."""
    nv = len(F)
    own = np.empty((nv, nv))
    for i in range(nv):
        for j in range(nv):
            own[i, j] = _entry(P, i, j)
    half = F @ own
    for i in range(nv):
        for j in range(i + 1):
            total = Q[j, i]
            for k in range(nv):
                total += half[j, k] * F[i, k]
            P[_row(i) + j] = total
    moved = np.empty(nv)
    for y in range(nv, n):
        row = P[_row(y) : _row(y) + nv]
        for i in range(nv):
            total = 0.0
            for k in range(nv):
                total += row[k] * F[i, k]
            moved[i] = total
        row[:] = moved


@compiled
def _update(
    x: Array, P: Array, n: int, columns: Indices, J: Array, innovations: Array, R: Array, W: Array,
    turning: Indices,
) -> float:  # fmt: skip
    """Correct `x` and `P` by measurements; return their NIS, nan without changes if S is none.

    With S = J P J' + R = L L' and A = L^-1 J P the new covariance is P - A' A, which stays
    symmetric by construction, and the correction of the state is A' L^-1 times the innovation.

    Parameters
    ----------
    W
        Working memory, (2, m d + 3 or more, n or more): A and B of the new covariance P - A' B.
    """
    A, B = W[0], W[1]
    rows = J.shape[0] * J.shape[1]
    nis, y = _whiten(P, n, columns, J, innovations, R, A)
    if math.isnan(nis):
        return nis
    change = np.zeros(n)
    for a in range(rows):
        row, same = A[a], B[a]
        for j in range(n):
            change[j] += y[a] * row[j]
            same[j] = row[j]
    if len(turning):
        _turn(P, n, A, B, rows, turning, change)
        rows += 2
    for j in range(n):
        x[j] += change[j]
    if rows % 2:  # they are subtracted in pairs
        A[rows, :n], B[rows, :n] = 0.0, 0.0
        rows += 1
    _subtract(P, n, A, B, rows)
    return nis


@compiled
def _whiten(  # noqa: C901 - one loop nest
    P: Array, n: int, columns: Indices, J: Array, innovations: Array, R: Array, A: Array
) -> tuple[float, Array]:
    """Write L^-1 J P into `A`; return the NIS, nan if S has no factor L, and L^-1 innovation."""
    m, d, k = J.shape
    column = np.empty(n)
    for a in range(m):
        A[d * a : d * (a + 1), :n] = 0.0
        for c in range(k):
            _read_column(P, n, columns[a, c], column)
            for r in range(d):
                share, row = J[a, r, c], A[d * a + r]
                for j in range(n):
                    row[j] += share * column[j]
    L, y, nis = np.empty((m * d, m * d)), np.empty(m * d), 0.0
    for a in range(m * d):
        y[a] = innovations[a // d, a % d]
        for b in range(a + 1):
            to, r = b // d, b % d
            total = R[to, a % d, r] if a // d == to else 0.0
            for c in range(k):
                total += A[a, columns[to, c]] * J[to, r, c]
            for c in range(b):
                total -= L[a, c] * L[b, c]
            if a > b:
                L[a, b] = total / L[b, b]
                y[a] -= L[a, b] * y[b]
            elif total > 0.0:
                L[a, a] = math.sqrt(total)
            else:
                return math.nan, y
        y[a] /= L[a, a]
        nis += y[a] * y[a]
    for a in range(m * d):
        row = A[a]
        for b in range(a):
            share, other = L[a, b], A[b]
            for j in range(n):
                row[j] -= share * other[j]
        scale = 1.0 / L[a, a]
        for j in range(n):
            row[j] *= scale
    return nis, y


@compiled
def _turn(P: Array, n: int, A: Array, B: Array, rows: int, turning: Indices, change: Array) -> None:
    """Turn corrections of positions with that of the heading, and prepare the same for `P`.

    A correction by dp and dtheta moves a point by V(dtheta) dp, the exponential of SE(2). The
    errors that the covariance describes then are those at the new estimate: M P M', where M adds
    J Delta times the error of the heading to the error of a point that moved by Delta. That is
    P + u v' + v u' with u = J Delta, and v the heading's row and half its variance times u.
    """
    half = 0.5 * change[HEADING]
    sinc = math.sin(half) / half if abs(half) > 1e-8 else 1.0
    c, s = sinc * math.cos(half), sinc * math.sin(half)
    u, v = A[rows], A[rows + 1]
    u[:n] = 0.0
    for at in turning:
        dx, dy = change[at], change[at + 1]
        change[at], change[at + 1] = c * dx - s * dy, s * dx + c * dy
        u[at], u[at + 1] = -change[at + 1], change[at]
    _read_column(P, n, HEADING, v)
    for a in range(rows):
        share, row = A[a, HEADING], B[a]
        for j in range(n):
            v[j] -= share * row[j]
    variance = 0.5 * v[HEADING]
    for j in range(n):
        v[j] += variance * u[j]
        B[rows, j], B[rows + 1, j] = -v[j], -u[j]


@compiled
def _subtract(P: Array, n: int, A: Array, B: Array, rows: int) -> None:
    """Subtract A' B: one pass, two rows of the covariance and two or four of A and B at a time."""
    for i in range(0, n, 2):
        length = i + 1
        upper = P[_row(i) : _row(i) + length]
        if length == n:
            for a in range(rows):
                for j in range(length):
                    upper[j] -= A[a, i] * B[a, j]
            return
        lower = P[_row(length) : _row(length) + length]
        for a in range(0, rows - 3, 4):
            b0, b1, b2, b3 = B[a], B[a + 1], B[a + 2], B[a + 3]
            s0, s1, s2, s3 = A[a, i], A[a + 1, i], A[a + 2, i], A[a + 3, i]
            t0, t1, t2, t3 = A[a, length], A[a + 1, length], A[a + 2, length], A[a + 3, length]
            for j in range(length):
                p, q, r, s = b0[j], b1[j], b2[j], b3[j]
                upper[j] -= s0 * p + s1 * q + s2 * r + s3 * s
                lower[j] -= t0 * p + t1 * q + t2 * r + t3 * s
            p, q, r, s = b0[length], b1[length], b2[length], b3[length]
            P[_row(length) + length] -= t0 * p + t1 * q + t2 * r + t3 * s
        for a in range(rows - rows % 4, rows, 2):
            b0, b1 = B[a], B[a + 1]
            s0, s1, t0, t1 = A[a, i], A[a + 1, i], A[a, length], A[a + 1, length]
            for j in range(length):
                p, q = b0[j], b1[j]
                upper[j] -= s0 * p + s1 * q
                lower[j] -= t0 * p + t1 * q
            P[_row(length) + length] -= t0 * b0[length] + t1 * b1[length]


@compiled
def _append(P: Array, n: int, columns: Indices, J: Array, noise: Array) -> None:
    """Write the rows of new states behind the n that there are."""
    w, k = J.shape
    across, column = np.zeros((w, n)), np.empty(n)
    for c in range(k):
        _read_column(P, n, columns[c], column)
        for r in range(w):
            for j in range(n):
                across[r, j] += J[r, c] * column[j]
    for r in range(w):
        at = _row(n + r)
        P[at : at + n] = across[r]
        for q in range(r + 1):
            total = 0.5 * (noise[r, q] + noise[q, r])
            for c in range(k):
                total += across[r, columns[c]] * J[q, c]
            P[at + n + q] = total


@compiled
def _remove(P: Array, n: int, first: int, width: int) -> None:
    """Write the last `width` rows and columns over those from `first` on."""
    last = n - width
    if first == last:
        return
    for r in range(width):
        source, to = _row(last + r), _row(first + r)
        for j in range(first):
            P[to + j] = P[source + j]
        for q in range(r + 1):
            P[to + first + q] = P[source + last + q]
        for j in range(first + width, last):
            P[_row(j) + first + r] = P[source + j]


@compiled
def _innovation_covariances(
    P: Array, firsts: Indices, seconds: Indices, columns: Indices, J: Array
) -> Array:
    """Return J_a P J_b' of pairs of measurements, without their noise, (pairs, d, d)."""
    _, d, k = J.shape
    found, half = np.empty((len(firsts), d, d)), np.empty((d, k))
    for pair in range(len(firsts)):
        a, b = firsts[pair], seconds[pair]
        half[:] = 0.0
        for i in range(k):
            for j in range(k):
                value = _entry(P, columns[a, i], columns[b, j])
                for r in range(d):
                    half[r, j] += J[a, r, i] * value
        for r in range(d):
            for q in range(d):
                total = 0.0
                for j in range(k):
                    total += half[r, j] * J[b, q, j]
                found[pair, r, q] = total
    return found
