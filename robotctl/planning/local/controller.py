"""Input and output of a local controller, which follows a path round what stands in the way."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.planning.costmap.planning_map import PlanningMap


class LocalSituation(NamedTuple):
    """The robot, its path and its surroundings at one step."""

    pose: SE2
    """`base` in `world`."""
    twist: Twist
    """Present velocity of `base`."""
    path: NDArray[np.float64]
    """(n, 3) poses of `base` in `world` [m, m, rad], n >= 2, from near the robot to the goal."""
    reverse: NDArray[np.bool_]
    """(n - 1,): whether the piece from each pose to the next is driven backwards."""
    space: PlanningMap
    """What the robot must not touch, around it; beyond the map's edge everything is blocked."""
    moving: NDArray[np.float64]
    """(k, 5) what moves by itself: x, y, vx, vy in `world` and its radius [m, m/s]."""
    speed_m_s: float
    """Largest speed here [m/s], > 0."""


class LocalMotion(NamedTuple):
    """The velocity of a step."""

    v_m_s: float
    omega_rad_s: float
    ahead: NDArray[np.float64]
    """(m, 3) poses of `base` in `world` that this velocity leads through, for people to see."""
    blocked: bool = False
    """Whether the robot stands because no velocity leads on."""
    text: str = ""
    """Why it stands or slows down, for people; empty if nothing hinders it."""


class Controller(Protocol):
    """Follows a path; it keeps what it decided last."""

    def reset(self) -> None:
        """Forget the last step: the path is another one, or the robot was moved."""

    def step(self, situation: LocalSituation) -> LocalMotion:
        """Return the next velocity, from which the robot can always stop before it touches."""
