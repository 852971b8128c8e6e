"""Shortest paths of a car between two poses: Dubins (forward alone) and Reeds-Shepp (with reverse).

A path is up to five pieces of a smallest turning circle or straight. Here the radius is 1 and the
start is the origin, looking along x; lengths are signed, below 0 is reverse. Formulas:

- Dubins: Shkel and Lumelsky, "Classification of the Dubins set", 2001, equations 9 to 16.
- Reeds-Shepp: "Optimal paths for a car that goes both forwards and backwards", 1990, section 8.
  Each of its equations stands for up to eight words by three symmetries: the path driven in
  reverse (x and the turns change sign), mirrored (left and right change), and from its end to its
  start.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import borrows, compiled

LEFT, STRAIGHT, RIGHT = 1, 0, -1
"""Turn of a piece, by the sign of its curvature when driven forward."""
PIECES: Final = 5
_HALF_PI: Final = 0.5 * math.pi
_EPSILON: Final = 1e-10
_END: Final = 9
"""In place of a turn, behind the last piece of a word."""


@compiled
def reeds_shepp(x: float, y: float, theta: float) -> NDArray[np.float64]:
    """Return the shortest path to a pose, (2, 5): turns, and signed lengths [radii]."""
    best = np.zeros((2, PIECES))
    best_length = np.inf
    word, found = np.zeros(PIECES), np.zeros(PIECES)
    c, s = math.cos(theta), math.sin(theta)
    # The start as seen from the end, mirrored along the way: the path from its end to its start.
    back_x, back_y = x * c + y * s, x * s - y * c
    for equation in range(8):
        # The others' words are of the same kind when driven from their end to their start.
        for symmetry in range(8 if equation in (2, 5, 6) else 4):
            timed, mirrored, backward = symmetry & 1, symmetry & 2, symmetry & 4
            px, py = (back_x, back_y) if backward else (x, y)
            px, py = -px if timed else px, -py if mirrored else py
            turned = (timed != 0) != (mirrored != 0)
            angle, sine = (-theta, -s) if turned else (theta, s)
            if not _solve(equation, px, py, angle, sine, c, word, found):
                continue
            length = 0.0
            for k in range(PIECES):
                length += abs(found[k])
            if length >= best_length - _EPSILON:
                continue
            best_length = length
            _keep(word, found, timed != 0, mirrored != 0, backward != 0, best)
    return best


@compiled
@borrows
def _keep(
    word: NDArray[np.float64],
    found: NDArray[np.float64],
    timed: bool,
    mirrored: bool,
    backward: bool,
    best: NDArray[np.float64],
) -> None:
    """Write a word, with its symmetries undone, as the best so far."""
    count = 0
    while count < PIECES and word[count] != _END:
        count += 1
    best[:] = 0.0
    for k in range(count):
        at = count - 1 - k if backward else k
        best[0, at] = -word[k] if mirrored else word[k]
        best[1, at] = -found[k] if timed else found[k]


@compiled
def _wrapped(angle: float) -> float:
    """Return an angle in [-pi, pi)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


@compiled
@borrows
def _solve(
    equation: int,
    x: float,
    y: float,
    theta: float,
    sine: float,
    cosine: float,
    word: NDArray[np.float64],
    found: NDArray[np.float64],
) -> bool:
    """Solve one equation of section 8 for its lengths; return whether it has a solution.

    The turns of its word are written too, and a 9 behind the last.
    """
    # Centres of the last circle as seen from the first one: of the same hand, and of the other.
    same_x, same_y = x - sine, y - 1.0 + cosine
    other_x, other_y = x + sine, y - 1.0 - cosine
    if equation == 0:
        return _csc_same(same_x, same_y, theta, word, found)
    if equation == 1:
        return _csc_other(other_x, other_y, theta, word, found)
    if equation == 2:
        return _ccc(same_x, same_y, theta, word, found)
    if equation == 3:
        return _cccc_apart(other_x, other_y, theta, word, found)
    if equation == 4:
        return _cccc_together(other_x, other_y, theta, word, found)
    if equation == 5:
        return _ccsc_same(same_x, same_y, theta, word, found)
    if equation == 6:
        return _ccsc_other(other_x, other_y, theta, word, found)
    return _ccscc(other_x, other_y, theta, word, found)


@compiled
@borrows
def _write(
    word: NDArray[np.float64],
    found: NDArray[np.float64],
    turns: tuple[int, int, int, int, int],
    lengths: tuple[float, float, float, float, float],
) -> bool:
    """Write a word and its lengths; return that there is one."""
    for k in range(PIECES):
        word[k] = turns[k]
        found[k] = lengths[k]
    return True


@compiled
@borrows
def _csc_same(
    x: float, y: float, theta: float, word: NDArray[np.float64], found: NDArray[np.float64]
) -> bool:
    """Equation 8.1: L+ S+ L+."""
    u, t = math.hypot(x, y), math.atan2(y, x)
    v = _wrapped(theta - t)
    if t < -_EPSILON or v < -_EPSILON:
        return False
    return _write(word, found, (1, 0, 1, _END, _END), (t, u, v, 0.0, 0.0))


@compiled
@borrows
def _csc_other(
    x: float, y: float, theta: float, word: NDArray[np.float64], found: NDArray[np.float64]
) -> bool:
    """Equation 8.2: L+ S+ R+."""
    squared = x * x + y * y
    if squared < 4.0:
        return False
    u = math.sqrt(squared - 4.0)
    t = _wrapped(math.atan2(y, x) + math.atan2(2.0, u))
    v = _wrapped(t - theta)
    if t < -_EPSILON or v < -_EPSILON:
        return False
    return _write(word, found, (1, 0, -1, _END, _END), (t, u, v, 0.0, 0.0))


@compiled
@borrows
def _ccc(
    x: float, y: float, theta: float, word: NDArray[np.float64], found: NDArray[np.float64]
) -> bool:
    """Equations 8.3 and 8.4: L+ R- L, the last either way."""
    rho = math.hypot(x, y)
    if rho > 4.0:
        return False
    u = -2.0 * math.asin(0.25 * rho)
    t = _wrapped(math.atan2(y, x) + 0.5 * u + math.pi)
    v = _wrapped(theta - t + u)
    if t < -_EPSILON:
        return False
    return _write(word, found, (1, -1, 1, _END, _END), (t, u, v, 0.0, 0.0))


@compiled
@borrows
def _cccc_apart(
    x: float, y: float, theta: float, word: NDArray[np.float64], found: NDArray[np.float64]
) -> bool:
    """Equation 8.7: L+ R+u L-u R-."""
    cosine = 0.25 * (2.0 + math.hypot(x, y))
    if cosine > 1.0:
        return False
    u = math.acos(cosine)
    t, v = _tau_omega(u, -u, x, y, theta)
    if t < -_EPSILON or v > _EPSILON:
        return False
    return _write(word, found, (1, -1, 1, -1, _END), (t, u, -u, v, 0.0))


@compiled
@borrows
def _cccc_together(
    x: float, y: float, theta: float, word: NDArray[np.float64], found: NDArray[np.float64]
) -> bool:
    """Equation 8.8: L+ R-u L-u R+."""
    cosine = (20.0 - x * x - y * y) / 16.0
    if not 0.0 <= cosine <= 1.0:
        return False
    u = -math.acos(cosine)
    t, v = _tau_omega(u, u, x, y, theta)
    if t < -_EPSILON or v < -_EPSILON:
        return False
    return _write(word, found, (1, -1, 1, -1, _END), (t, u, u, v, 0.0))


@compiled
@borrows
def _ccsc_same(
    x: float, y: float, theta: float, word: NDArray[np.float64], found: NDArray[np.float64]
) -> bool:
    """Equation 8.9: L+ R-(pi/2) S- L-."""
    rho = math.hypot(x, y)
    if rho < 2.0:
        return False
    r = math.sqrt(rho**2 - 4.0)
    u = 2.0 - r
    t = _wrapped(math.atan2(y, x) + math.atan2(r, -2.0))
    v = _wrapped(theta - _HALF_PI - t)
    if t < -_EPSILON or u > _EPSILON or v > _EPSILON:
        return False
    return _write(word, found, (1, -1, 0, 1, _END), (t, -_HALF_PI, u, v, 0.0))


@compiled
@borrows
def _ccsc_other(
    x: float, y: float, theta: float, word: NDArray[np.float64], found: NDArray[np.float64]
) -> bool:
    """Equation 8.10: L+ R-(pi/2) S- R-."""
    rho = math.hypot(x, y)
    if rho < 2.0:
        return False
    t, u = math.atan2(x, -y), 2.0 - rho
    v = _wrapped(t + _HALF_PI - theta)
    if t < -_EPSILON or u > _EPSILON or v > _EPSILON:
        return False
    return _write(word, found, (1, -1, 0, -1, _END), (t, -_HALF_PI, u, v, 0.0))


@compiled
@borrows
def _ccscc(
    x: float, y: float, theta: float, word: NDArray[np.float64], found: NDArray[np.float64]
) -> bool:
    """Equation 8.11: L+ R-(pi/2) S- L-(pi/2) R+."""
    rho = math.hypot(x, y)
    if rho < 2.0:
        return False
    u = 4.0 - math.sqrt(rho**2 - 4.0)
    if u > _EPSILON:
        return False
    t = _wrapped(math.atan2((4.0 - u) * x - 2.0 * y, -2.0 * x + (u - 4.0) * y))
    v = _wrapped(t - theta)
    if t < -_EPSILON or v < -_EPSILON:
        return False
    return _write(word, found, (1, -1, 0, 1, -1), (t, -_HALF_PI, u, -_HALF_PI, v))


@compiled
def _tau_omega(u: float, v: float, xi: float, eta: float, theta: float) -> tuple[float, float]:
    """Return the first and the last angle of equations 8.7 and 8.8, by 8.6."""
    delta = _wrapped(u - v)
    a = math.sin(u) - math.sin(delta)
    b = math.cos(u) - math.cos(delta) - 1.0
    first = math.atan2(eta * a - xi * b, xi * a + eta * b)
    second = 2.0 * (math.cos(delta) - math.cos(v) - math.cos(u)) + 3.0
    tau = _wrapped(first + math.pi) if second < 0.0 else _wrapped(first)
    return tau, _wrapped(tau - u + v - theta)


@compiled
def dubins(x: float, y: float, theta: float) -> NDArray[np.float64]:
    """Return the shortest path forwards to a pose, (2, 5): turns, and lengths [radii]."""
    best = np.zeros((2, PIECES))
    d, heading = math.hypot(x, y), math.atan2(y, x)
    alpha, beta = -heading, theta - heading
    sa, sb, ca, cb = math.sin(alpha), math.sin(beta), math.cos(alpha), math.cos(beta)
    cab = math.cos(alpha - beta)
    shortest = np.inf
    for word in range(6):
        if word == 0:  # L S L
            squared = 2.0 + d * d - 2.0 * cab + 2.0 * d * (sa - sb)
            turn = math.atan2(cb - ca, d + sa - sb)
            first, last, turns = turn - alpha, beta - turn, (1, 0, 1)
        elif word == 1:  # R S R
            squared = 2.0 + d * d - 2.0 * cab + 2.0 * d * (sb - sa)
            turn = math.atan2(ca - cb, d - sa + sb)
            first, last, turns = alpha - turn, turn - beta, (-1, 0, -1)
        elif word == 2:  # L S R
            squared = -2.0 + d * d + 2.0 * cab + 2.0 * d * (sa + sb)
            middle = math.sqrt(max(squared, 0.0))
            turn = math.atan2(-ca - cb, d + sa + sb) - math.atan2(-2.0, middle)
            first, last, turns = turn - alpha, turn - beta, (1, 0, -1)
        elif word == 3:  # R S L
            squared = -2.0 + d * d + 2.0 * cab - 2.0 * d * (sa + sb)
            middle = math.sqrt(max(squared, 0.0))
            turn = math.atan2(ca + cb, d - sa - sb) - math.atan2(2.0, middle)
            first, last, turns = alpha - turn, beta - turn, (-1, 0, 1)
        else:
            first, middle, last = _three_turns(d, alpha, beta, word == 4)
            turns = (-1, 1, -1) if word == 4 else (1, -1, 1)
            squared = middle * abs(middle)
        if squared < 0.0:
            continue
        first, last = first % (2.0 * math.pi), last % (2.0 * math.pi)
        # A full turn that is none but for rounding.
        first = 0.0 if first > 2.0 * math.pi - 1e-9 else first
        last = 0.0 if last > 2.0 * math.pi - 1e-9 else last
        length = first + math.sqrt(squared) + last
        if length < shortest:
            shortest = length
            for k in range(3):
                best[0, k] = turns[k]
            best[1, 0], best[1, 1], best[1, 2] = first, math.sqrt(squared), last
    return best


@compiled
def _three_turns(d: float, alpha: float, beta: float, right: bool) -> tuple[float, float, float]:
    """Return the lengths of R L R, or of L R L as its mirror image; the second -1: none."""
    sa, sb, ca, cb = math.sin(alpha), math.sin(beta), math.cos(alpha), math.cos(beta)
    sign = -1.0 if right else 1.0
    cosine = (6.0 - d * d + 2.0 * math.cos(alpha - beta) - sign * 2.0 * d * (sa - sb)) / 8.0
    if abs(cosine) > 1.0:
        return 0.0, -1.0, 0.0
    middle = 2.0 * math.pi - math.acos(cosine)
    first = 0.5 * middle + sign * (math.atan2(sign * (cb - ca), d + sign * (sa - sb)) - alpha)
    return first, middle, sign * (beta - alpha) - first + middle


@compiled
def along(
    path: NDArray[np.float64], radius: float, spacing: float
) -> tuple[NDArray[np.float64], NDArray[np.int8]]:
    """Return poses along a path, (n, 3), at most so far apart, and the gear to each, (n,): 1 or -1.

    Parameters
    ----------
    path
        (2, 5), as the curves give it.
    radius
        Of the smallest turning circle.
    spacing
        The ends of the pieces are always among the poses.
    """
    count = 1
    for k in range(PIECES):
        if path[1, k] != 0.0:
            count += max(1, math.ceil(abs(path[1, k]) * radius / spacing))
    poses, gears = np.empty((count, 3)), np.empty(count, np.int8)
    poses[0] = 0.0
    gears[0] = 1
    at = 1
    x, y, theta = 0.0, 0.0, 0.0
    for k in range(PIECES):
        turn, length = path[0, k], path[1, k] * radius
        if length == 0.0:
            continue
        steps = max(1, math.ceil(abs(length) / spacing))
        for i in range(1, steps + 1):
            s = length * i / steps
            angle = theta + turn * s / radius
            if turn == 0.0:
                poses[at, 0], poses[at, 1] = x + s * math.cos(theta), y + s * math.sin(theta)
            else:
                poses[at, 0] = x + turn * radius * (math.sin(angle) - math.sin(theta))
                poses[at, 1] = y - turn * radius * (math.cos(angle) - math.cos(theta))
            poses[at, 2] = angle
            gears[at] = 1 if length > 0.0 else -1
            at += 1
        x, y, theta = poses[at - 1]
    return poses, gears
