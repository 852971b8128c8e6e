"""Encounters of a moving body with people whom a lidar sees move."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robotctl.model.footprint import Footprint
from robotctl.planning.guard.course import LEAST_CLOSING, Course

_APART_M: Final = 0.1
"""Maximum distance between two points of the outline that are looked at [m]."""
_NEARS_M_S: Final = 0.1
"""Least speed of an approaching person towards the body [m/s]: tracks of others are as fast."""
_TOUCHES_M: Final = 1e-6
"""Distance below which no direction can be told [m]."""


class Encounter(NamedTuple):
    """Approach of a point of the body and a person to each other."""

    closing: float
    """Way of the point towards the person per way of `base`, > 0."""
    gap_m: float
    """Distance between both [m]; below 0: they overlap."""
    nears_m_s: float
    """Speed of the person towards the point [m/s]."""


def edge_of(body: Footprint) -> NDArray[np.float64]:
    """Return points of an outline, corners included, (n, 2) [m]."""
    return np.concatenate(
        [
            np.linspace(a, b, math.ceil(math.dist(a, b) / _APART_M) + 1)[:-1]
            for a, b in body.open_sides
        ]
    )


def encounters(
    edge: NDArray[np.float64], moving: Sequence[Sequence[float]], course: Course, reach_m: float
) -> list[Encounter]:
    """Return the encounters of all points of the body with all who move.

    Parameters
    ----------
    edge
        See `edge_of`.
    moving
        x, y, vx, vy in `base` and radius of each [m, m/s], at least one.
    course
        Of `base`; on the spot, ways are those of what is farthest from it.
    reach_m
        Distance of that [m].
    """
    ahead, left, turn = course
    moves = np.array((ahead, left)) + turn * np.column_stack([-edge[:, 1], edge[:, 0]])
    if course.is_on_the_spot:
        moves /= reach_m
    others = np.array(moving)[:, np.newaxis]  # (k, 1, 5), to the points' (n, 2)
    away = others[..., :2] - edge
    away_m = np.maximum(np.hypot(away[..., 0], away[..., 1]), _TOUCHES_M)
    towards = away / away_m[..., np.newaxis]
    closing = (towards * moves).sum(axis=2)
    nears_m_s = -(towards * others[..., 2:4]).sum(axis=2)
    both = (closing > LEAST_CLOSING) & (nears_m_s > _NEARS_M_S)
    columns = closing[both], (away_m - others[..., 4])[both], nears_m_s[both]
    return [Encounter(*row) for row in zip(*(each.tolist() for each in columns), strict=True)]
