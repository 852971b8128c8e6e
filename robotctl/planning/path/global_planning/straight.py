"""Paths of straight pieces for a robot that turns on the spot at their corners."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.map.planning_map import PlanningMap, body_hits

_STEP: Final = 0.25
"""The greatest distance that a corner of the body moves between two checks [cells]."""
_CIRCLES: Final = 4
"""Number of circles between the one in which the body can turn and the one in which it fits."""


def radii(space: PlanningMap, margin: float) -> list[float]:
    """Return the circles to plan with, one after the other, until there is a path [cells].

    In the first the body can turn anywhere, and keeps a margin; in the last it fits lengthwise at
    most. In a passage an even number of cells wide the middle lies between two cells.
    """
    narrow = max(space.inscribed - 0.5, 0.0)
    steps = np.linspace(space.circumscribed, narrow, _CIRCLES).tolist()
    return list(dict.fromkeys((space.circumscribed + margin, *steps)))


def straight_poses(points: NDArray[np.float64], start: SE2, goal: SE2) -> NDArray[np.float64]:
    """Return the poses (n, 3) between which the robot either drives straight or turns on the spot.

    Parameters
    ----------
    points
        (m, 2), of which the first and last are those of start and goal.
    start, goal
        With the headings there.
    """
    steps = np.diff(points, axis=0)
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    both = np.empty((2 * len(steps), 3))
    both[0::2] = np.column_stack([points[:-1], headings])
    both[1::2] = np.column_stack([points[1:], headings])
    first = [start.x_m, start.y_m, start.theta_rad]
    return np.vstack([first, both, [goal.x_m, goal.y_m, goal.theta_rad]])


def collisions(space: PlanningMap, poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where `base` is as its body first touches something, of each piece, (k, 2) [cells]."""
    stuck: NDArray[np.float64] = _collisions(
        space.blocked, space.clearance, space.samples, space.discs, space.circumscribed, poses
    )
    return stuck


@compiled
def _collisions(
    blocked: NDArray[np.bool_],
    clearance: NDArray[np.float32],
    samples: NDArray[np.float64],
    discs: NDArray[np.float64],
    reach: float,
    poses: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Go along each piece until the body touches something."""
    stuck = np.empty((max(len(poses) - 1, 0), 2))
    found = 0
    for i in range(len(poses) - 1):
        x, y, theta = poses[i]
        right, up = poses[i + 1, 0] - x, poses[i + 1, 1] - y
        turn = poses[i + 1, 2] - theta
        turn -= math.tau * math.ceil((turn - math.pi) / math.tau)  # to (-pi, pi]
        count = 1 + int(max(np.hypot(right, up), abs(turn) * reach) / _STEP)
        for j in range(count + 1):
            share = j / count
            at_x, at_y = x + share * right, y + share * up
            if body_hits(blocked, clearance, samples, discs, at_x, at_y, theta + share * turn):
                stuck[found] = at_x, at_y
                found += 1
                break
    return stuck[:found]
