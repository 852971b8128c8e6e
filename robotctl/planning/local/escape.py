"""The way out for a robot that stands nearer to something than it would ever have driven.

A map that changes, a pose that was corrected or a person may bring something so near that every
motion begins within the margin, or in contact by the map. Then the exact distance counts: the robot
creeps where it never comes nearer than it is, and gets away farthest.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.compiled import compiled
from robotctl.planning.local.body import SPACING, TOUCH, Body, Surroundings, gap
from robotctl.planning.local.rollout import Problem

_TURNS: Final = np.array([0.0, 0.5, -0.5, 1.0, -1.0])
"""Shares of a slow turn."""
_SLOW_TURN: Final = 0.6
"""[rad/s]."""
_AWAY_S: Final = 0.8
"""Looked at."""
_POSES: Final = 24
_NEARER: Final = 1e-6


@compiled
def separation(
    blocked: NDArray[np.bool_], body: Body, x: float, y: float, c: float, s: float
) -> float:
    """Return how far the axis that separates a body best from the nearest cell keeps them apart.

    Below 0 by how much they overlap; at most 2 cells. The axes are those of the separating axis
    theorem: the normals of the body's sides and of the cell's.
    """
    rows, columns = blocked.shape
    least = 2.0
    high_x = high_y = -np.inf
    low_x = low_y = np.inf
    for k in range(len(body.outline)):
        px, py = body.outline[k, 0], body.outline[k, 1]
        low_x, high_x = min(low_x, c * px - s * py), max(high_x, c * px - s * py)
        low_y, high_y = min(low_y, s * px + c * py), max(high_y, s * px + c * py)
    for row in range(int(np.floor(y + low_y)) - 2, int(np.floor(y + high_y)) + 3):
        for column in range(int(np.floor(x + low_x)) - 2, int(np.floor(x + high_x)) + 3):
            inside = 0 <= row < rows and 0 <= column < columns
            if inside and not blocked[row, column]:
                continue
            dx, dy = column - x, row - y
            apart = max(dx - high_x, low_x - dx - 1.0, dy - high_y, low_y - dy - 1.0)
            for k in range(len(body.sides)):
                nx = c * body.sides[k, 0] - s * body.sides[k, 1]
                ny = s * body.sides[k, 0] + c * body.sides[k, 1]
                nearest = nx * dx + ny * dy + min(nx, 0.0) + min(ny, 0.0)
                apart = max(apart, nearest - body.sides[k, 2])
            least = min(least, apart)
    return least


@compiled
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
def way_out(problem: Problem, body: Body) -> tuple[float, float]:
    """Return the slow velocity that leads away, 0 if each leads nearer to something.

    `body` is the one without margin.
    """
    motion, blocked = problem.motion, problem.space.blocked
    x, y, angle = problem.pose
    here = separation(blocked, body, x, y, float(np.cos(angle)), float(np.sin(angle)))
    best, chosen = here + 0.05, (0.0, 0.0)
    for i in range(3):
        for k in range(len(_TURNS)):
            v = (i - 1) * motion.creep
            omega = _TURNS[k] * _SLOW_TURN
            if motion.curvature_max != np.inf:
                omega = _TURNS[k] * min(motion.curvature_max * abs(v), _SLOW_TURN)
            least, last = np.inf, here
            for m in range(1, _POSES + 1):
                time = m * _AWAY_S / _POSES
                half = 0.5 * omega * time
                there_x = x + v * time * np.cos(angle + half)
                there_y = y + v * time * np.sin(angle + half)
                c, s = float(np.cos(angle + 2.0 * half)), float(np.sin(angle + 2.0 * half))
                last = separation(blocked, body, there_x, there_y, c, s)
                least = min(least, last)
            if least >= here - _NEARER and last > best:
                best, chosen = last, (v, omega)
    return chosen
