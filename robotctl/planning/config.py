"""Settings of the navigator."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from robotctl.errors import InvalidValue
from robotctl.planning.behaviours.follow_wall import WallConfig
from robotctl.planning.costmap.zone import Zone
from robotctl.planning.guard.obstacle_guard import GuardConfig
from robotctl.planning.journey.recovery import RecoveryConfig
from robotctl.planning.local.pursuit import PursuitConfig


@dataclass(frozen=True, slots=True)
class PilotConfig:
    """How journeys are planned and driven.

    Parameters
    ----------
    planner
        A name of `PLANNERS`; empty: hybrid for a robot that steers, astar for another.
    controller
        A name of `CONTROLLERS`.
    topology
        File of a topological map, of `robotctl topology build`: the places that the robot can drive
        to by recognising them; empty: none.
    margin_m
        Between the body and obstacles on a planned path [m], >= 0.
    zone
        Parts of the world that the robot keeps out of, or passes slowly.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    planner: str = ""
    controller: str = "mppi"
    topology: str = ""
    margin_m: float = 0.05
    zone: tuple[Zone, ...] = ()

    def __post_init__(self) -> None:
        if not 0.0 <= self.margin_m < math.inf:
            raise InvalidValue(
                "margin_m", f"{self.margin_m} found, a number >= 0 allowed", self.margin_m
            )


@dataclass(frozen=True, slots=True)
class NavigationConfig:
    """Settings of the navigator.

    Parameters
    ----------
    rate_hz
        Steps in a second [Hz], in [5, 100].
    guided_speed_m_s
        Largest speed towards positions from the ground station [m/s], > 0.
    return_speed_m_s
        Maximum speed of RTL [m/s], > 0.
    look_around_speed_m_s
        Largest speed of a robot that does not know where it is [m/s], > 0.
    pursuit, guard, wall, pilot, recovery
        Following paths, minding obstacles, following walls, driving by plan, and what to do where
        that does not get on.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    rate_hz: float = 20.0
    guided_speed_m_s: float = 0.4
    return_speed_m_s: float = 0.3
    look_around_speed_m_s: float = 0.25
    pursuit: PursuitConfig = field(default_factory=PursuitConfig)
    guard: GuardConfig = field(default_factory=GuardConfig)
    wall: WallConfig = field(default_factory=WallConfig)
    pilot: PilotConfig = field(default_factory=PilotConfig)
    recovery: RecoveryConfig = field(default_factory=RecoveryConfig)

    def __post_init__(self) -> None:
        if not 5.0 <= self.rate_hz <= 100.0:
            raise InvalidValue("rate_hz", f"{self.rate_hz} found, 5 to 100 allowed", self.rate_hz)
        for key in ("guided_speed_m_s", "return_speed_m_s", "look_around_speed_m_s"):
            if not 0.0 < getattr(self, key) < math.inf:
                raise InvalidValue(
                    key, f"{getattr(self, key)} found, a number > 0 allowed", getattr(self, key)
                )
