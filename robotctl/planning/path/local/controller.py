"""Input and output of a local controller, which follows a path round what stands in the way."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.planning.map.planning_map import PlanningMap


@dataclass(frozen=True, slots=True)
class ControllerConfig:
    """How a path is followed.

    Parameters
    ----------
    dt_s
        Between two steps [s], > 0.
    tau_s
        How far ahead velocities are looked at [s], > `dt_s`.
    samples
        Candidates of a step, >= 50.
    deceleration_m_s2
        Braking that the robot manages for sure [m/s^2], > 0.
    reaction_s
        From a command to its effect at the latest [s], >= 0.
    margin_m
        Kept between the body and obstacles, except at creeping speed [m], >= 0.
    comfort_m
        Nearer to an obstacle than this, a velocity costs more [m], > 0.
    goal, path, clearance, heading, smoothness
        Weights, >= 0: of the way left, of the distance from the path, of nearness to obstacles, of
        looking elsewhere, of changes.
    position_tolerance_m, heading_tolerance_rad
        The goal is reached within these [m], [rad], > 0.
    seed
        Of controllers that draw random samples.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    dt_s: float = 0.05
    tau_s: float = 1.5
    samples: int = 500
    deceleration_m_s2: float = 0.8
    reaction_s: float = 0.1
    margin_m: float = 0.04
    comfort_m: float = 0.25
    goal: float = 1.0
    path: float = 0.3
    clearance: float = 0.5
    heading: float = 0.5
    smoothness: float = 0.15
    position_tolerance_m: float = 0.05
    heading_tolerance_rad: float = 0.08
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the ranges."""
        positive = (
            "dt_s", "deceleration_m_s2", "comfort_m", "position_tolerance_m",
            "heading_tolerance_rad",
        )  # fmt: skip
        for key in positive:
            if not 0.0 < getattr(self, key) < math.inf:
                raise ValueError(f"{key} must be finite and > 0, found {getattr(self, key)}")
        for key in ("reaction_s", "margin_m", "goal", "path", "clearance", "heading", "smoothness"):
            if not 0.0 <= getattr(self, key) < math.inf:
                raise ValueError(f"{key} must be finite and >= 0, found {getattr(self, key)}")
        if not self.dt_s < self.tau_s < math.inf:
            raise ValueError(f"tau_s must be above dt_s = {self.dt_s}, found {self.tau_s}")
        if self.samples < 50:
            raise ValueError(f"samples must be at least 50, found {self.samples}")


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

    @property
    def speed_m_s(self) -> float:
        """Speed of `base` over the floor [m/s]."""
        return Twist(self.v_m_s, self.omega_rad_s, self.vy_m_s).speed_m_s


class Controller(Protocol):
    """Follows a path; it keeps what it decided last."""

    def reset(self) -> None:
        """Forget the last step: the path is another one, or the robot was moved."""

    def step(self, situation: LocalSituation) -> LocalMotion:
        """Return the next velocity, from which the robot can always stop before it touches."""
