"""Inner loops of the floor homography, compiled: equations, refinement, degeneracy, consensus.

Points here are normalised (Hartley 1997): their centroid is 0 and their mean distance from it is
sqrt(2), without which the linear equations mix 1 with the squares of pixels.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.compiled import compiled

Array: TypeAlias = NDArray[np.float64]

_STEPS = 30
_SMALL_STEP = 1e-12
_SMALL_GAIN = 1e-9
_ON_A_LINE = 1e-6
_MISSED = 1e-4


@compiled
def normalised(points: Array) -> tuple[Array, float, float, float]:
    """Return s (p - c) for points (n, 2), and s, c_x and c_y."""
    n = len(points)
    x, y = points[:, 0].sum() / n, points[:, 1].sum() / n
    spread = 0.0
    for i in range(n):
        spread += math.hypot(points[i, 0] - x, points[i, 1] - y) / n
    scale = math.sqrt(2.0) / spread if spread > 0.0 else 1.0
    out = np.empty((n, 2))
    for i in range(n):
        out[i, 0] = scale * (points[i, 0] - x)
        out[i, 1] = scale * (points[i, 1] - y)
    return out, scale, x, y


@compiled
def linear_equations(ground: Array, pixels: Array) -> Array:
    """Return A^T A, (9, 9), of the linear equations A h = 0: two rows of A for each point.

    u (g x + h y + i) = a x + b y + c and v (g x + h y + i) = d x + e y + f.
    """
    M = np.zeros((9, 9))
    row = np.zeros(9)
    for i in range(len(ground)):
        x, y = ground[i]
        for axis in range(2):
            value = pixels[i, axis]
            row[:6] = 0.0
            row[3 * axis], row[3 * axis + 1], row[3 * axis + 2] = x, y, 1.0
            row[6], row[7], row[8] = -value * x, -value * y, -value
            for j in range(9):
                for k in range(9):
                    M[j, k] += row[j] * row[k]
    return M


@compiled
def whitening(h: Array, x: float, y: float, sigma_u: float, sigma_x: float) -> Array:
    """Return W, (2, 2) lower, with W^T W the inverse covariance of a pixel's residual.

    The covariance is sigma_u^2 I + sigma_x^2 J J^T, J the Jacobian of the pixel by the point.
    """
    w = h[6] * x + h[7] * y + h[8]
    u, v = (h[0] * x + h[1] * y + h[2]) / w, (h[3] * x + h[4] * y + h[5]) / w
    j00, j01 = (h[0] - u * h[6]) / w, (h[1] - u * h[7]) / w
    j10, j11 = (h[3] - v * h[6]) / w, (h[4] - v * h[7]) / w
    a = sigma_u**2 + sigma_x**2 * (j00 * j00 + j01 * j01)
    b = sigma_x**2 * (j00 * j10 + j01 * j11)
    c = sigma_u**2 + sigma_x**2 * (j10 * j10 + j11 * j11)
    l00 = math.sqrt(a)
    l10 = b / l00
    l11 = math.sqrt(max(c - l10 * l10, 1e-300))
    W = np.zeros((2, 2))
    W[0, 0] = 1.0 / l00
    W[1, 0] = -l10 / (l00 * l11)
    W[1, 1] = 1.0 / l11
    return W


@compiled
def _cholesky(M: Array) -> bool:
    """Overwrite the lower half of M, (9, 9), by its factor L, M = L L^T; False if none is."""
    for j in range(9):
        for i in range(j, 9):
            rest = M[i, j]
            for k in range(j):
                rest -= M[i, k] * M[j, k]
            if i > j:
                M[i, j] = rest / M[j, j]
            elif rest > 0.0:
                M[j, j] = math.sqrt(rest)
            else:
                return False
    return True


@compiled
def _solved(L: Array, r: Array) -> Array:
    """Return the solution of L L^T x = r, (9,)."""
    x = r.copy()
    for i in range(9):
        for k in range(i):
            x[i] -= L[i, k] * x[k]
        x[i] /= L[i, i]
    for i in range(8, -1, -1):
        for k in range(i + 1, 9):
            x[i] -= L[k, i] * x[k]
        x[i] /= L[i, i]
    return x


@compiled
def _equations(h: Array, ground: Array, pixels: Array, W: Array, M: Array, r: Array) -> float:
    """Fill M = J^T J + h h^T and r = J^T e of the whitened residuals e; return e^T e.

    J h = 0, since scaling h moves no pixel; h h^T makes M invertible without taking part in the
    step, which stays orthogonal to h.
    """
    for j in range(9):
        for k in range(9):
            M[j, k] = h[j] * h[k]
        r[j] = 0.0
    cost = 0.0
    row = np.zeros((2, 9))
    for i in range(len(ground)):
        x, y = ground[i]
        w = h[6] * x + h[7] * y + h[8]
        u, v = (h[0] * x + h[1] * y + h[2]) / w, (h[3] * x + h[4] * y + h[5]) / w
        du, dv = pixels[i, 0] - u, pixels[i, 1] - v
        w00, w10, w11 = W[i, 0, 0], W[i, 1, 0], W[i, 1, 1]
        p = (x / w, y / w, 1.0 / w)
        for k in range(3):
            row[0, k], row[1, k] = w00 * p[k], w10 * p[k]
            row[1, 3 + k] = w11 * p[k]
            row[0, 6 + k], row[1, 6 + k] = -w00 * u * p[k], -(w10 * u + w11 * v) * p[k]
        e = (w00 * du, w10 * du + w11 * dv)
        cost += e[0] * e[0] + e[1] * e[1]
        for axis in range(2):
            for j in range(9):
                r[j] += row[axis, j] * e[axis]
                for k in range(9):
                    M[j, k] += row[axis, j] * row[axis, k]
    return cost


@compiled
def _unit(h: Array, step: Array) -> tuple[Array, float]:
    """Return h + step scaled to norm 1, and |step|^2."""
    out = np.empty(9)
    norm = size = 0.0
    for j in range(9):
        out[j] = h[j] + step[j]
        norm += out[j] ** 2
        size += step[j] ** 2
    for j in range(9):
        out[j] /= math.sqrt(norm)
    return out, size


@compiled
def _descend(h: Array, ground: Array, pixels: Array, W: Array, M: Array) -> tuple[Array, float]:
    """Minimise the residuals weighted by W from h on; M then is the matrix of `_equations`."""
    r, scratch = np.zeros(9), np.zeros(9)
    L = np.zeros((9, 9))
    cost = _equations(h, ground, pixels, W, M, r)
    damping = 0.0
    for _ in range(_STEPS):
        for j in range(9):
            for k in range(9):
                L[j, k] = M[j, k] * (1.0 + damping) if j == k else M[j, k]
        if not _cholesky(L):
            break
        trial, size = _unit(h, _solved(L, r))
        trial_cost = _equations(trial, ground, pixels, W, L, scratch)
        small = size < _SMALL_STEP**2
        if trial_cost <= cost:
            small = small or cost - trial_cost <= _SMALL_GAIN * cost
            h = trial
            cost = _equations(h, ground, pixels, W, M, r)
            damping *= 0.1
        else:
            damping = max(10.0 * damping, 1e-4)
        if small:
            break
    return h, cost


@compiled
def refine(
    h: Array, ground: Array, pixels: Array, sigma_u: float, sigma_x: float
) -> tuple[Array, Array, float]:
    """Minimise the residuals in the picture by the method of Levenberg and Marquardt.

    Returns
    -------
    tuple
        h, (9,), |h| = 1; its covariance, (9, 9), of rank 8, nan if the points do not determine
        it; the sum of squared residuals in standard deviations.
    """
    W = np.empty((len(ground), 2, 2))
    M, P = np.zeros((9, 9)), np.full((9, 9), math.nan)
    cost = 0.0
    # The weights depend on h if places are uncertain: repeat with the refined one.
    for _ in range(1 if sigma_x == 0.0 else 2):
        for i in range(len(ground)):
            W[i] = whitening(h, ground[i, 0], ground[i, 1], sigma_u, sigma_x)
        h, cost = _descend(h, ground, pixels, W, M)
    if _cholesky(M):
        for j in range(9):
            unit = np.zeros(9)
            unit[j] = 1.0
            P[j] = _solved(M, unit) - h[j] * h
    return h, P, cost


@compiled
def unnormalised(
    h: Array, P: Array, of_ground: tuple[float, float, float], of_pixels: tuple[float, float, float]
) -> tuple[Array, Array]:
    """Return h and its covariance, (9,) and (9, 9), |h| = 1, for points before `normalised`.

    H = B H_n A, where A normalises the ground and B undoes it for the pixels. It is linear in H_n;
    scaling it to norm 1 takes its own direction out of the covariance.
    """
    s, x, y = of_ground
    t, u, v = of_pixels
    A = np.array([[s, 0.0, -s * x], [0.0, s, -s * y], [0.0, 0.0, 1.0]])
    B = np.array([[1.0 / t, 0.0, u], [0.0, 1.0 / t, v], [0.0, 0.0, 1.0]])
    L = np.empty((9, 9))
    out = np.zeros(9)
    norm = 0.0
    for i in range(9):
        for k in range(9):
            L[i, k] = B[i // 3, k // 3] * A[k % 3, i % 3]
            out[i] += L[i, k] * h[k]
        norm += out[i] ** 2
    norm = math.sqrt(norm)
    for i in range(9):
        out[i] /= norm
    for k in range(9):
        along = 0.0
        for i in range(9):
            along += out[i] * L[i, k]
        for i in range(9):
            L[i, k] = (L[i, k] - out[i] * along) / norm
    return out, _sandwich(L, P)


@compiled
def _sandwich(L: Array, P: Array) -> Array:
    """Return L P L^T, (9, 9)."""
    LP, out = np.zeros((9, 9)), np.zeros((9, 9))
    for i in range(9):
        for k in range(9):
            for j in range(9):
                LP[i, j] += L[i, k] * P[k, j]
    for i in range(9):
        for j in range(9):
            for k in range(9):
                out[i, j] += LP[i, k] * L[j, k]
    return out


@compiled
def _deviation(points: Array, chosen: NDArray[np.bool_], left_out: int) -> float:
    """Return how far the chosen points but one are from their best line, root mean square."""
    x = y = xx = xy = yy = 0.0
    count = 0
    for i in range(len(points)):
        if chosen[i] and i != left_out:
            count += 1
            x += points[i, 0]
            y += points[i, 1]
    x, y = x / max(count, 1), y / max(count, 1)
    for i in range(len(points)):
        if chosen[i] and i != left_out:
            dx, dy = points[i, 0] - x, points[i, 1] - y
            xx += dx * dx
            xy += dx * dy
            yy += dy * dy
    # The smaller eigenvalue of the scatter is its determinant over the larger one.
    larger = 0.5 * (xx + yy + math.hypot(xx - yy, 2.0 * xy))
    smaller = max(xx * yy - xy * xy, 0.0) / larger if larger > 0.0 else 0.0
    return math.sqrt(smaller / max(count, 1))


@compiled
def least_deviation(points: Array) -> tuple[float, float, int]:
    """Return how far points, (n, 2), are from one line, all or all but one.

    Returns
    -------
    tuple
        The deviation, root mean square, of all from their best line; the least deviation where
        one point may be left out; how many points differ. Those that coincide count as one.
    """
    first = np.ones(len(points), dtype=np.bool_)
    for i in range(len(points)):
        for j in range(i):
            if points[i, 0] == points[j, 0] and points[i, 1] == points[j, 1]:
                first[i] = False
                break
    least = math.inf
    for left_out in range(len(points)):
        if first[left_out]:
            least = min(least, _deviation(points, first, left_out))
    return _deviation(points, first, -1), least, int(first.sum())


@compiled
def agreeing(
    h: Array, ground: Array, pixels: Array, sigma_u: float, sigma_x: float, gate: float
) -> tuple[NDArray[np.bool_], float]:
    """Return which points are within `gate` squared standard deviations, on the side of most.

    Returns
    -------
    tuple
        Whether a point does, (n,), and the sum of the squared distances, each up to `gate` (Torr
        and Zisserman 2000).
    """
    n = len(ground)
    agree = np.zeros(n, dtype=np.bool_)
    ahead = 0
    for i in range(n):
        ahead += h[6] * ground[i, 0] + h[7] * ground[i, 1] + h[8] > 0.0
    side = 1.0 if 2 * ahead >= n else -1.0
    cost = 0.0
    for i in range(n):
        x, y = ground[i]
        w = h[6] * x + h[7] * y + h[8]
        distance = gate
        if w * side > 0.0:
            W = whitening(h, x, y, sigma_u, sigma_x)
            du = pixels[i, 0] - (h[0] * x + h[1] * y + h[2]) / w
            dv = pixels[i, 1] - (h[3] * x + h[4] * y + h[5]) / w
            distance = (W[0, 0] * du) ** 2 + (W[1, 0] * du + W[1, 1] * dv) ** 2
        agree[i] = distance < gate
        cost += min(gate, distance)
    return agree, cost


@compiled
def _area(points: Array, a: int, b: int, c: int) -> float:
    """Return twice the area of a triangle, > 0 counter-clockwise."""
    area: float = (points[b, 0] - points[a, 0]) * (points[c, 1] - points[a, 1]) - (
        points[b, 1] - points[a, 1]
    ) * (points[c, 0] - points[a, 0])
    return area


@compiled
def _frame(points: Array, chosen: NDArray[np.int64]) -> tuple[Array, bool]:
    """Return the matrix that maps (1,0,0), (0,1,0), (0,0,1), (1,1,1) to four points, (3, 3).

    And whether there is one: no three are on a line.
    """
    a, b, c, d = chosen
    weights = (_area(points, d, b, c), _area(points, a, d, c), _area(points, a, b, d))
    frame = np.empty((3, 3))
    least = abs(_area(points, a, b, c))
    for k in range(3):
        frame[0, k] = weights[k] * points[chosen[k], 0]
        frame[1, k] = weights[k] * points[chosen[k], 1]
        frame[2, k] = weights[k]
        least = min(least, abs(weights[k]))
    return frame, least > _ON_A_LINE


@compiled
def _adjugate(A: Array) -> Array:
    """Return det(A) A^-1, (3, 3)."""
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            p, q, r, t = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
            out[i, j] = A[p, r] * A[q, t] - A[p, t] * A[q, r]
    return out


@compiled
def consensus(
    ground: Array,
    pixels: Array,
    samples: NDArray[np.int64],
    sigma_u: float,
    sigma_x: float,
    gate: float,
) -> Array:
    """Return the h, (9,), |h| = 1, of four points on which most points agree (RANSAC).

    `samples`, (m, 4), are drawn with repetition; those that repeat a point count for nothing. It
    ends when four agreeing points would have been missed with a probability of `_MISSED`.
    """
    best, best_cost = np.zeros(9), math.inf
    h = np.empty(9)
    needed, tried = math.inf, 0
    for chosen in samples:
        from_frame, found = _frame(ground, chosen)
        to_frame, also = _frame(pixels, chosen)
        if not (found and also):
            continue
        tried += 1
        inverse = _adjugate(from_frame)
        for i in range(3):
            for j in range(3):
                h[3 * i + j] = 0.0
                for k in range(3):
                    h[3 * i + j] += to_frame[i, k] * inverse[k, j]
        h /= math.sqrt((h * h).sum())
        agree, cost = agreeing(h, ground, pixels, sigma_u, sigma_x, gate)
        if cost < best_cost:
            best[:], best_cost = h, cost
            hit = min(max((agree.sum() / len(ground)) ** 4, 1e-9), 1.0 - 1e-12)
            needed = math.log(_MISSED) / math.log1p(-hit)
        if tried >= needed:
            break
    return best
