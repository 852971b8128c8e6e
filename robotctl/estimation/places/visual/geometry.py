"""Whether matches of two images fit one camera motion: RANSAC for a plane, then for a scene.

A homography fits what is on one plane or far away. What is nearer moves along epipolar lines; a
fundamental matrix that agrees with the homography needs only two more matches (plane and parallax:
Chum, Werner, Matas, CVPR 2005). Of the two the one counts that chance would make less likely
(Moisan, Stival, IJCV 57(3), 2004).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled

PLANE_TOLERANCE: Final = 0.01
"""Distance of a match from where a homography has it, over the diagonal: 8 px of 640 x 480."""
LINE_TOLERANCE: Final = 0.005
"""Distance of a match from its epipolar line."""
_PLANE_TRIALS: Final = 300
"""Finds what a third of the matches follow, in 97 of 100 cases; most wrong draws end at once."""
_SCENE_TRIALS: Final = 100
"""Finds what a fifth of the matches off the plane follow, in 98 of 100 cases."""
_LEAST: Final = 8
"""Matches that can say anything of a scene."""


@dataclass(frozen=True, slots=True)
class Geometry:
    """How two images fit together.

    Parameters
    ----------
    model
        `plane`: by a homography. `scene`: by a fundamental matrix. `none`: not at all.
    inliers
        (k,), indices of the matches that fit.
    log10_chance
        Log of how many such fits random matches would have; 0 without any.
    """

    model: Literal["plane", "scene", "none"]
    inliers: NDArray[np.int64]
    log10_chance: float


def common_geometry(
    points_a: NDArray[np.float64],
    points_b: NDArray[np.float64],
    aspect: float,
    rng: np.random.Generator,
) -> Geometry:
    """Fit one motion of the camera to matches.

    Parameters
    ----------
    points_a, points_b
        (n, 2) each, matches in two images, over the images' diagonal.
    aspect
        Shorter over longer side of the second image.
    rng
        Draws matches.
    """
    none = Geometry("none", np.empty(0, np.int64), 0.0)
    n = len(points_a)
    if n < _LEAST:
        return none
    H, plane = _best_plane(points_a, points_b, rng.random((_PLANE_TRIALS, 4)), PLANE_TOLERANCE)
    area = aspect / (1.0 + aspect**2)  # of an image whose diagonal is 1
    by_plane = log10_chance(n, int(plane.sum()), 4, math.pi * PLANE_TOLERANCE**2 / area)
    if by_plane >= 0.0:
        return none
    pairs = rng.random((_SCENE_TRIALS, 2))
    scene = _best_scene(points_a, points_b, H, plane, pairs, LINE_TOLERANCE)
    # A fundamental matrix has one degree of freedom less than eight matches determine.
    by_scene = log10_chance(n, int(scene.sum()), 7, 2.0 * LINE_TOLERANCE / area)
    if by_plane <= by_scene:
        return Geometry("plane", np.flatnonzero(plane), by_plane)
    return Geometry("scene", np.flatnonzero(scene), by_scene)


def log10_chance(matches: int, inliers: int, sample: int, share: float) -> float:
    """Return the log of how many fits as good random matches are expected to have.

    Parameters
    ----------
    matches, inliers
        How many there are, and how many fit.
    sample
        How many matches determine the model.
    share
        Of the image that is within the tolerance of a prediction.
    """
    if inliers <= sample:
        return 0.0
    log_tests = math.log(matches - sample) + _log_choose(matches, inliers)
    log_tests += _log_choose(inliers, sample)
    return (log_tests + (inliers - sample) * math.log(share)) / math.log(10.0)


def _log_choose(n: int, k: int) -> float:
    return math.lgamma(n + 1) - math.lgamma(k + 1) - math.lgamma(n - k + 1)


@compiled
def _homography(
    a: NDArray[np.float64], b: NDArray[np.float64], chosen: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the homography, (3, 3), that takes chosen points of `a` to `b` by least squares.

    The lower right entry is 1: the corner of one image is never at the horizon of another that
    looks at the same things. Zeros where the points do not determine it.
    """
    normal = np.zeros((8, 9))
    row = np.zeros(9)
    for k in chosen:
        x, y = a[k, 0], a[k, 1]
        for axis in range(2):
            z = b[k, axis]
            row[:] = 0.0
            row[3 * axis], row[3 * axis + 1], row[3 * axis + 2] = x, y, 1.0
            row[6], row[7], row[8] = -x * z, -y * z, z
            for i in range(8):
                if row[i] != 0.0:
                    for j in range(9):
                        normal[i, j] += row[i] * row[j]
    H = np.zeros((3, 3))
    flat = H.reshape(9)
    flat[8] = 1.0 if _solve(normal, flat) else 0.0
    return H


@compiled
def _solve(system: NDArray[np.float64], x: NDArray[np.float64]) -> bool:
    """Solve A x = b of `system` = (A, b), (8, 9), by elimination with pivots, in place.

    Return whether A has full rank; else x is what it was.
    """
    for i in range(8):
        pivot = i
        for j in range(i + 1, 8):
            if abs(system[j, i]) > abs(system[pivot, i]):
                pivot = j
        if abs(system[pivot, i]) < 1e-14:
            return False
        for j in range(9):
            system[i, j], system[pivot, j] = system[pivot, j], system[i, j]
        for j in range(i + 1, 8):
            factor = system[j, i] / system[i, i]
            for m in range(i, 9):
                system[j, m] -= factor * system[i, m]
    for i in range(7, -1, -1):
        total = system[i, 8]
        for j in range(i + 1, 8):
            total -= system[i, j] * x[j]
        x[i] = total / system[i, i]
    return True


@compiled
def _mapped_off(H: NDArray[np.float64], x: float, y: float, u: float, v: float) -> float:
    """Return the squared distance from (u, v) to where a homography takes (x, y)."""
    w = H[2, 0] * x + H[2, 1] * y + H[2, 2]
    if w <= 1e-9:
        return np.inf
    du = (H[0, 0] * x + H[0, 1] * y + H[0, 2]) / w - u
    dv = (H[1, 0] * x + H[1, 1] * y + H[1, 2]) / w - v
    return float(du * du + dv * dv)


@compiled
def _on_plane(
    a: NDArray[np.float64], b: NDArray[np.float64], H: NDArray[np.float64], tolerance: float
) -> NDArray[np.bool_]:
    """Return which matches a homography takes to each other, there and back."""
    inside = np.zeros(len(a), np.bool_)
    G = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            p, q, r, s = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
            G[i, j] = H[p, r] * H[q, s] - H[p, s] * H[q, r]
    det = H[0, 0] * G[0, 0] + H[0, 1] * G[1, 0] + H[0, 2] * G[2, 0]
    if det <= 1e-6:  # it mirrors, or flattens to a line
        return inside
    most = tolerance * tolerance
    for i in range(len(a)):
        x, y, u, v = a[i, 0], a[i, 1], b[i, 0], b[i, 1]
        inside[i] = _mapped_off(H, x, y, u, v) < most and _mapped_off(G, u, v, x, y) < most
    return inside


@compiled
def _drawn(drawn: NDArray[np.float64], n: int) -> NDArray[np.int64]:
    """Return distinct indices below n from numbers of [0, 1), one for each (Floyd)."""
    k = len(drawn)
    chosen = np.empty(k, np.int64)
    for i in range(k):
        last = n - k + i
        index = int(drawn[i] * (last + 1))
        for j in range(i):
            if chosen[j] == index:
                index = last
                break
        chosen[i] = index
    return chosen


@compiled
def _turn_alike(a: NDArray[np.float64], b: NDArray[np.float64], chosen: NDArray[np.int64]) -> bool:
    """Return whether each three of four points turn the same way in both images.

    They do where one camera saw a plane twice from the same side (Marquez-Neila et al., 2015), and
    in one of eight draws from wrong matches.
    """
    for skipped in range(4):
        i, j, k = chosen[(skipped + 1) % 4], chosen[(skipped + 2) % 4], chosen[(skipped + 3) % 4]
        in_a = (a[j, 0] - a[i, 0]) * (a[k, 1] - a[i, 1]) - (a[j, 1] - a[i, 1]) * (a[k, 0] - a[i, 0])
        in_b = (b[j, 0] - b[i, 0]) * (b[k, 1] - b[i, 1]) - (b[j, 1] - b[i, 1]) * (b[k, 0] - b[i, 0])
        if in_a * in_b <= 0.0:
            return False
    return True


@compiled
def _best_plane(
    a: NDArray[np.float64], b: NDArray[np.float64], drawn: NDArray[np.float64], tolerance: float
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the homography with most inliers, refitted to them, and the inliers."""
    n = len(a)
    best_H = np.zeros((3, 3))
    best = np.zeros(n, np.bool_)
    most = 0
    needed = float(len(drawn))
    for trial in range(len(drawn)):
        if trial >= needed:
            break
        chosen = _drawn(drawn[trial], n)
        if not _turn_alike(a, b, chosen):
            continue
        H = _homography(a, b, chosen)
        inside = _on_plane(a, b, H, tolerance)
        count = np.sum(inside)
        if count <= most:
            continue
        for _ in range(2):
            refined_H = _homography(a, b, np.flatnonzero(inside))
            refined = _on_plane(a, b, refined_H, tolerance)
            if np.sum(refined) <= count:
                break
            H, inside, count = refined_H, refined, np.sum(refined)
        best_H, best, most = H, inside, count
        all_good = (most / n) ** 4
        if all_good >= 1.0:
            break
        needed = np.log(0.01) / np.log(1.0 - all_good)
    return best_H, best


@compiled
def _best_scene(
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    H: NDArray[np.float64],
    plane: NDArray[np.bool_],
    drawn: NDArray[np.float64],
    tolerance: float,
) -> NDArray[np.bool_]:
    """Return the inliers of the best fundamental matrix with this plane, maybe none."""
    best = np.zeros(len(a), np.bool_)
    off = np.flatnonzero(~plane)
    if len(off) < 3:
        return best
    most = 0
    line = np.empty((2, 3))
    F = np.empty((3, 3))
    needed = float(len(drawn))
    for trial in range(len(drawn)):
        if trial >= needed:
            break
        pair = _drawn(drawn[trial], len(off))
        for k in range(2):
            i = off[pair[k]]
            x = H[0, 0] * a[i, 0] + H[0, 1] * a[i, 1] + H[0, 2]
            y = H[1, 0] * a[i, 0] + H[1, 1] * a[i, 1] + H[1, 2]
            w = H[2, 0] * a[i, 0] + H[2, 1] * a[i, 1] + H[2, 2]
            u, v = b[i, 0], b[i, 1]
            # The line through where the plane has it and where it is: (x, y, w) cross (u, v, 1).
            line[k, 0] = y - w * v
            line[k, 1] = w * u - x
            line[k, 2] = x * v - y * u
        e = np.cross(line[0], line[1])  # the epipole
        for j in range(3):  # F = [e] H
            F[0, j] = e[1] * H[2, j] - e[2] * H[1, j]
            F[1, j] = e[2] * H[0, j] - e[0] * H[2, j]
            F[2, j] = e[0] * H[1, j] - e[1] * H[0, j]
        inside = _on_lines(a, b, F, tolerance)
        count = np.sum(inside)
        if count > most:
            best, most = inside, count
            all_good = (np.sum(inside[off]) / len(off)) ** 2
            if all_good >= 1.0:
                break
            if all_good > 0.0:
                needed = np.log(0.01) / np.log(1.0 - all_good)
    return best


@compiled
def _on_lines(
    a: NDArray[np.float64], b: NDArray[np.float64], F: NDArray[np.float64], tolerance: float
) -> NDArray[np.bool_]:
    """Return which matches are at their epipolar lines, by Sampson's distance."""
    inside = np.zeros(len(a), np.bool_)
    for i in range(len(a)):
        x, y, u, v = a[i, 0], a[i, 1], b[i, 0], b[i, 1]
        p = F[0, 0] * x + F[0, 1] * y + F[0, 2]
        q = F[1, 0] * x + F[1, 1] * y + F[1, 2]
        r = F[2, 0] * x + F[2, 1] * y + F[2, 2]
        s = F[0, 0] * u + F[1, 0] * v + F[2, 0]
        t = F[0, 1] * u + F[1, 1] * v + F[2, 1]
        off = u * p + v * q + r
        inside[i] = off * off < tolerance**2 * (p * p + q * q + s * s + t * t)
    return inside
