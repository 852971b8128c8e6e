"""People who walk together, between whom a robot does not go."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

_SAME_M_S: Final = 0.3
"""Difference of two velocities up to which people walk together [m/s]."""


def with_groups(
    moving: NDArray[np.float64], group_m: float, here: tuple[float, float], reach_m: float
) -> NDArray[np.float64]:
    """Return what moves, and between each two who walk together a disc that moves along.

    Parameters
    ----------
    moving
        (k, 5), as `LocalSituation.moving`.
    group_m
        Distance between two people up to which they are together [m]; 0: nobody is.
    here, reach_m
        Place of the robot, and radius of its circle [m]: where it is between them already, they
        are no group to it.
    """
    if group_m <= 0.0 or len(moving) < 2:
        return moving
    first, second = np.triu_indices(len(moving), 1)
    one, other = moving[first], moving[second]
    apart_m = np.hypot(*(one - other)[:, :2].T)
    together = (apart_m <= group_m) & (np.hypot(*(one - other)[:, 2:4].T) <= _SAME_M_S)
    between = 0.5 * (one + other)
    between[:, 4] = 0.5 * apart_m
    away_m = np.hypot(*(between[:, :2] - here).T)
    together &= away_m > between[:, 4] + reach_m
    return np.concatenate([moving, between[together]])
