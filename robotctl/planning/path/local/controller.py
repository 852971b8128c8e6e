"""Input and output of a local controller, which follows a path round what stands in the way."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.planning.follow_config import FEWEST, FollowConfig
from robotctl.planning.map.planning_map import PlanningMap


@dataclass(frozen=True, slots=True)
class ControllerConfig(FollowConfig):
    """How a path is followed by a robot: its file's settings, and what others of them say.

    Parameters
    ----------
    dt_s
        Interval between two steps [s], > 0, below `tau_s`.
    deceleration_m_s2
        Braking that the robot manages for sure [m/s^2], > 0.
    margin_m
        Clearance kept between the body and obstacles, except at creeping speed [m], >= 0.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    dt_s: float = 0.05
    deceleration_m_s2: float = 0.8
    margin_m: float = 0.04

    def __post_init__(self) -> None:
        FollowConfig.__post_init__(self)  # super() does not know a class with slots
        for key in ("dt_s", "deceleration_m_s2"):
            if not 0.0 < getattr(self, key) < math.inf:
                raise ValueError(f"{key} must be finite and > 0, found {getattr(self, key)}")
        if not 0.0 <= self.margin_m < math.inf:
            raise ValueError(f"margin_m must be finite and >= 0, found {self.margin_m}")
        if not self.dt_s < self.tau_s:
            raise ValueError(f"tau_s must be above dt_s = {self.dt_s}, found {self.tau_s}")

    @classmethod
    def of_robot(
        cls, follow: FollowConfig, *, dt_s: float, deceleration_m_s2: float, margin_m: float
    ) -> ControllerConfig:
        """Return the settings of a robot's file with those of its other tables."""
        values: dict[str, Any] = {each.name: getattr(follow, each.name) for each in fields(follow)}
        return cls(**values, dt_s=dt_s, deceleration_m_s2=deceleration_m_s2, margin_m=margin_m)


class LocalSituation(NamedTuple):
    """The robot, its path and its surroundings at one step."""

    pose: SE2
    """`base` in `world`."""
    twist: Twist
    """Present velocity of `base`."""
    path: NDArray[np.float64]
    """(n, 3) poses of `base` in `world` [m, m, rad], n >= 2, from near the robot to the goal.

    While the array is the same, the controller goes on from where it was along it.
    """
    reverse: NDArray[np.bool_]
    """(n - 1,): whether the piece from each pose to the next is driven backwards."""
    space: PlanningMap
    """Space around the robot; beyond the map's edge everything is blocked."""
    moving: NDArray[np.float64]
    """Moving things, (k, 5): x, y, vx, vy in `world` and radius [m, m/s]."""
    speed_m_s: float
    """Largest speed here [m/s], > 0."""
    effort: float = 1.0
    """Share of its samples that may be tried, in (0, 1]."""


class LocalMotion(NamedTuple):
    """The velocity of a step."""

    v_m_s: float
    omega_rad_s: float
    ahead: NDArray[np.float64]
    """(m, 3) poses of `base` in `world` that this velocity leads through, for people to see."""
    blocked: bool = False
    """Whether the robot has stood for half a second because no velocity leads on, or stands where
    only another path leads to the goal."""
    text: str = ""
    """Why it stands or slows down, for people; empty if nothing hinders it."""
    arrived: bool = False
    """Whether the robot stands at the path's last pose, within the tolerances."""
    vy_m_s: float = 0.0
    """Velocity to the left of holonomic drives [m/s]."""
    creeps: bool = False
    """Whether the robot is creeping away from something too near."""

    @property
    def speed_m_s(self) -> float:
        """Speed of `base` over the floor [m/s]."""
        return Twist(self.v_m_s, self.omega_rad_s, self.vy_m_s).speed_m_s


def tried(samples: int, effort: float) -> int:
    """Return how many of its samples a controller tries at an effort in (0, 1]."""
    return min(samples, max(FEWEST, math.ceil(effort * samples)))


class Controller(Protocol):
    """Follows a path; it keeps what it decided last."""

    def reset(self) -> None:
        """Forget the last step: the path is another one, or the robot was moved."""

    def step(self, situation: LocalSituation) -> LocalMotion:
        """Return the next velocity, from which the robot can always stop before it touches."""
