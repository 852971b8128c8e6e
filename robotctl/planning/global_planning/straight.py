"""Paths of straight pieces for a robot that turns on the spot at their corners."""

from __future__ import annotations

import itertools
import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.costmap.planning_map import PlanningMap

_STEP: Final = 0.25
"""The greatest distance that a corner of the body moves between two checks [cells]."""
_CIRCLES: Final = 4
"""Between that in which the body can turn and that in which it fits."""


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
    stuck = []
    for a, b in itertools.pairwise(poses):
        turn = wrap_angle(b[2] - a[2])
        corner = max(math.dist(a[:2], b[:2]), abs(turn) * space.circumscribed)
        count = 1 + int(corner / _STEP)
        share = np.linspace(0.0, 1.0, count + 1)[:, np.newaxis]
        between = a + share * np.array([b[0] - a[0], b[1] - a[1], turn])
        hits = space.collides(between)
        if hits.any():
            stuck.append(between[int(np.argmax(hits)), :2])
    return np.array(stuck).reshape(-1, 2)
