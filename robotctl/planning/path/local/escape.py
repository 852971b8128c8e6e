"""The way out for a robot that stands nearer to something than it would ever have driven.

A start beside a wall, a map that changes, a pose that was corrected or a person may bring something
so near that every motion begins within the margin, or in contact by the map. Nothing touches the
robot, or it would not have got there: the outline is drawn in on the sides where something reaches
into it, and by a little more, so that the tail may swing out as the robot turns away. What keeps
the rest free is driven at a creep: away from what is too near, or else along it.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import borrows, compiled
from robotctl.planning.path.local.body import SPACING, TOUCH, Body, Surroundings, gap
from robotctl.planning.path.local.rollout import Motion, RolloutProblem

_TURNS: Final = np.array([0.0, 0.04, -0.04, 0.1, -0.1, 0.25, -0.25, 0.5, -0.5, 1.0, -1.0])
"""Shares of a slow turn."""
_SLOW_TURN: Final = 0.6
"""[rad/s]."""
_AWAY_S: Final = 2.4
"""Length of an arc in time [s]: a tail that swings out is back after twice the overhang."""
_POSES: Final = 48
_FREE: Final = 8
"""Number of these poses that must be free: enough to stop in."""
_SWING: Final = 0.018
"""The tail may come nearer to what touches the robot by this per way of `base`, and by more per
gap: what the obstacle guard takes for driving along something."""
_GAP_M: Final = 0.2
_GAIN: Final = 0.05
"""Least room that a way has to gain [cells]."""
_ALONG: Final = 0.03
"""Way towards the path counts as so much room."""


@compiled
@borrows
def separation(
    blocked: NDArray[np.bool_], body: Body, x: float, y: float, c: float, s: float
) -> float:
    """Return how far the axis that separates a body best from the nearest cell keeps them apart.

    Below 0 by how much they overlap; at most 2 cells. The axes are those of the separating axis
    theorem: the normals of the body's sides and of the cell's.
    """
    least, first, point = 2.0, 0, 0
    while first < len(body.sides):
        last = _end_of_piece(body, first)
        box = _box(body, point, c, s)
        for row in range(int(np.floor(y + box[1])) - 2, int(np.floor(y + box[3])) + 3):
            for column in range(int(np.floor(x + box[0])) - 2, int(np.floor(x + box[2])) + 3):
                if _is_free(blocked, row, column):
                    continue
                dx, dy = column - x, row - y
                apart = max(dx - box[2], box[0] - dx - 1.0, dy - box[3], box[1] - dy - 1.0)
                for k in range(first, last):
                    apart = max(apart, _beyond(body, k, dx, dy, c, s))
                least = min(least, apart)
        first, point = last, int(body.outline[point, 2])
    return least


@compiled
def intrusions(
    blocked: NDArray[np.bool_], body: Body, pose: tuple[float, float, float], reach: float
) -> NDArray[np.float64]:
    """Return how deep cells reach in below each side of a body, (m,) [cells].

    A cell counts for the side of each piece that it is least deep below. Negative: the nearest cell
    is so far off; `-reach` where none is nearer.
    """
    x, y = pose[0], pose[1]
    c, s = float(np.cos(pose[2])), float(np.sin(pose[2]))
    deepest = np.full(len(body.sides), -reach)
    first, point = 0, 0
    while first < len(body.sides):
        last = _end_of_piece(body, first)
        box = _box(body, point, c, s)
        for row in range(int(np.floor(y + box[1])) - 2, int(np.floor(y + box[3])) + 3):
            for column in range(int(np.floor(x + box[0])) - 2, int(np.floor(x + box[2])) + 3):
                if _is_free(blocked, row, column):
                    continue
                side, apart = first, -np.inf
                for k in range(first, last):
                    beyond = _beyond(body, k, column - x, row - y, c, s)
                    if beyond > apart:
                        side, apart = k, beyond
                deepest[side] = max(deepest[side], -apart)
        first, point = last, int(body.outline[point, 2])
    return deepest


@compiled
@borrows
def _end_of_piece(body: Body, first: int) -> int:
    """Return the number of the side after those of a piece that begins with a side."""
    last = first
    while last < len(body.sides) and body.sides[last, 3] == body.sides[first, 3]:
        last += 1
    return last


@compiled
@borrows
def _box(body: Body, first: int, c: float, s: float) -> tuple[float, float, float, float]:
    """Return the box around a piece that is turned: least x and y, most x and y.

    `first` is the first point of its outline.
    """
    high_x = high_y = -np.inf
    low_x = low_y = np.inf
    for k in range(first, int(body.outline[first, 2])):
        px, py = body.outline[k, 0], body.outline[k, 1]
        low_x, high_x = min(low_x, c * px - s * py), max(high_x, c * px - s * py)
        low_y, high_y = min(low_y, s * px + c * py), max(high_y, s * px + c * py)
    return low_x, low_y, high_x, high_y


@compiled
@borrows
def _is_free(blocked: NDArray[np.bool_], row: int, column: int) -> bool:
    """Return whether a cell is on the map and not blocked."""
    rows, columns = blocked.shape
    return bool(0 <= row < rows and 0 <= column < columns and not blocked[row, column])


@compiled
@borrows
def _beyond(body: Body, k: int, dx: float, dy: float, c: float, s: float) -> float:
    """Return how far a cell, with its lower corner at dx, dy of the body, is beyond a side."""
    nx = c * body.sides[k, 0] - s * body.sides[k, 1]
    ny = s * body.sides[k, 0] + c * body.sides[k, 1]
    return float(nx * dx + ny * dy + min(nx, 0.0) + min(ny, 0.0) - body.sides[k, 2])


@compiled
@borrows
def is_too_near(space: Surroundings, body: Body, pose: tuple[float, float, float]) -> bool:
    """Return whether a body touches something where it is."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return (
        gap(
            space.clearance, body.outline, SPACING, body.discs, pose[0], pose[1], float(c), float(s)
        )
        == TOUCH
    )


@compiled
def way_out(
    problem: RolloutProblem, bare: Body, drawn_in: Body, target: tuple[float, float], side_m: float
) -> tuple[float, float]:
    """Return the slow velocity that leads away or along, 0 if none keeps free what is free.

    Parameters
    ----------
    bare
        The body without margin, which is to get away.
    drawn_in
        What of it must stay free.
    target
        A place on the path to go to where there is a choice.
    side_m
        Of a cell [m].
    """
    space, pose = problem.space, problem.pose
    here = _separation_at(space, bare, pose)
    swing = _SWING + max(here, 0.0) * side_m / _GAP_M
    way = np.hypot(target[0] - pose[0], target[1] - pose[1])
    best, chosen = 0.0, (0.0, 0.0)
    for v, omega in _creeps(problem.motion, bare, swing):
        if v < 0.0 and best > 0.0:
            break
        free, end = _driven(space, drawn_in, pose, v, omega)
        if free < _FREE:
            continue
        gain = _separation_at(space, bare, end) - here
        nearer = way - np.hypot(target[0] - end[0], target[1] - end[1])
        if gain < _GAIN and (gain < -_GAIN or nearer < 1.0):
            continue
        score = gain + _ALONG * nearer
        if score > best:
            best, chosen = score, (v, omega)
    return chosen


@compiled
def _creeps(motion: Motion, bare: Body, swing: float) -> list[tuple[float, float]]:
    """Return the slow velocities in which the tail swings out by no more than so much per way.

    Those ahead come first, and those backwards last, where a robot sees least.
    """
    ahead, behind = bare.outline[:, 0].max(), -bare.outline[:, 0].min()
    creeps = []
    for v, tail in ((motion.creep, behind), (0.0, 1.0), (-motion.creep, ahead)):
        most = min(motion.curvature_max, swing / tail) * abs(v)
        if v == 0.0:
            most = _SLOW_TURN if motion.curvature_max == np.inf else 0.0
        for turn in _TURNS:
            omega = max(min(turn * _SLOW_TURN, most), -most)
            if v != 0.0 or omega != 0.0:
                creeps.append((v, omega))
    return creeps


@compiled
def _driven(
    space: Surroundings, body: Body, pose: tuple[float, float, float], v: float, omega: float
) -> tuple[int, tuple[float, float, float]]:
    """Return the poses of an arc up to which a body is free, at most `_POSES`, and the last one."""
    x, y, angle = pose
    end = pose
    for k in range(_POSES):
        time = (k + 1) * _AWAY_S / _POSES
        half = 0.5 * omega * time
        to_x = x + v * time * np.cos(angle + half)
        to_y = y + v * time * np.sin(angle + half)
        to = (to_x, to_y, angle + 2.0 * half)
        if is_too_near(space, body, to):
            return k, end
        end = to
    return _POSES, end


@compiled
@borrows
def _separation_at(space: Surroundings, body: Body, pose: tuple[float, float, float]) -> float:
    """Return `separation` of a body at a pose."""
    c, s = float(np.cos(pose[2])), float(np.sin(pose[2]))
    return separation(space.blocked, body, pose[0], pose[1], c, s)
