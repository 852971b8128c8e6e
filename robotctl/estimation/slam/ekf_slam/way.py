"""Poses along a way of which some are known, by odometry between them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2

Array: TypeAlias = NDArray[np.float64]


def way_of(deltas: Array, rows: Sequence[int], known: Sequence[SE2]) -> Array:
    """Return all poses (n, 3), where what odometry misses of a known one grows evenly up to it.

    Parameters
    ----------
    deltas
        Of each pose in the frame of the one before, (n, 3); the first is not used.
    rows, known
        Which poses are known, in order, the first and the last among them; and these.
    """
    found = np.empty((len(deltas), 3))
    found[0] = known[0].x_m, known[0].y_m, known[0].theta_rad
    for (first, start), (last, goal) in pairwise(zip(rows, known, strict=True)):
        pose = start
        for row in range(first + 1, last + 1):
            pose = pose @ SE2(*deltas[row].tolist())
            found[row] = pose.x_m, pose.y_m, pose.theta_rad
        off = np.array([goal.x_m, goal.y_m, goal.theta_rad]) - found[last]
        off[2] = wrap_angle(float(off[2]))
        found[first + 1 : last + 1] += np.outer(
            np.arange(1, last - first + 1) / (last - first), off
        )
    return found
