"""Settings of planning, as they stand in a robot's file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Final, Literal, TypeAlias

from robotctl.config_values import check_ranges
from robotctl.errors import InvalidValue
from robotctl.model.footprint import Footprint
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.follow_config import FollowConfig
from robotctl.planning.guard_config import ApproachConfig, GuardMemoryConfig, NearPeopleConfig
from robotctl.planning.journey_config import (
    ExplorationConfig,
    PeopleConfig,
    RungsConfig,
    TravelConfig,
)
from robotctl.planning.map.config import MapConfig
from robotctl.planning.map.mask_config import MaskConfig
from robotctl.planning.map.zone import Zone

RungName: TypeAlias = Literal[
    "wait", "replan", "clear", "back_off", "retrace", "other_way", "look_around", "ask"
]
"""Names of what a robot in trouble may try."""

MOST_BLOCKED_S: Final = 1e6
LONGEST_WAIT_S: Final = 86400.0
MOST_RETRIES: Final = 1000
FARTHEST_BACK_M: Final = 5.0
MOST_RESERVE: Final = 10.0
"""Upper bounds of the values of the same names; beyond, a setting is a slip."""


@dataclass(frozen=True, slots=True)
class GuardConfig:
    """When the guard brakes.

    Parameters
    ----------
    margin_m
        Way that each corner of the body keeps to an obstacle ahead of it [m], > 0.
    deceleration_m_s2
        Braking that the robot manages for sure [m/s^2], > 0.
    reaction_s
        Time from an echo to the brakes, with the median filter and the ring's refresh [s], > 0.
    nose_m
        How far the robot reaches ahead of `base` [m], > 0: from there the gap to what the camera
        sees is counted; as far behind `base`, driving backwards.
    half_width_m
        Half the robot's width plus a little room [m], > 0: lateral position of its corners. `[body]
        outline` takes the place of both.
    cone_deg
        Sonars within this angle of the direction of travel look ahead [deg], > 0: without their
        readings the robot stands.
    blocked_max_s
        A robot blocked for this long gives up [s], > 0, at most 1e6.
    memory, approach, people
        How long what is out of sight is kept, when what a sonar hears comes nearer by itself, and
        how fast the robot drives near people.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    margin_m: float = 0.12
    deceleration_m_s2: float = 0.8
    reaction_s: float = 0.2
    nose_m: float = 0.2
    half_width_m: float = 0.18
    cone_deg: float = 30.0
    blocked_max_s: float = 10.0
    memory: GuardMemoryConfig = field(default_factory=GuardMemoryConfig)
    approach: ApproachConfig = field(default_factory=ApproachConfig)
    people: NearPeopleConfig = field(default_factory=NearPeopleConfig)

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if not is_dataclass(value) and not 0.0 < value < math.inf:
                raise InvalidValue(each.name, f"{value} found, a finite number > 0 allowed", value)
        if self.blocked_max_s > MOST_BLOCKED_S:
            raise InvalidValue(
                "blocked_max_s",
                f"{self.blocked_max_s} found, at most {MOST_BLOCKED_S:.0f} allowed",
                self.blocked_max_s,
            )

    def outline(self, mounts: Sequence[SonarMount]) -> Footprint:
        """Return the body of a robot whose file has no outline: it holds the nose and all sonars.

        Behind it reaches to the rearmost sonar, or as far as the nose ahead where none is behind.
        """
        front_m = max([self.nose_m, *(mount.x_m for mount in mounts)])
        rear_m = min((mount.x_m for mount in mounts), default=-self.nose_m)
        half_m = max([self.half_width_m, *(abs(mount.y_m) for mount in mounts)])
        return Footprint.rectangle(rear_m if rear_m < 0.0 else -self.nose_m, front_m, half_m)


@dataclass(frozen=True, slots=True)
class PursuitConfig:
    """How paths are followed.

    Parameters
    ----------
    lookahead_s
        The target point lies as far ahead as the robot drives in this time [s], > 0,
    lookahead_min_m, lookahead_max_m
        but within these lengths [m], > 0.
    acceleration_m_s2
        Deceleration planned for the goal and for corners [m/s^2], > 0; below the limiter's.
    lateral_acceleration_m_s2
        Largest v^2 / R in a bend [m/s^2], > 0.
    omega_max_rad_s
        Fastest turn [rad/s], > 0.
    alpha_rad_s2
        Angular deceleration planned for the end of a turn on the spot [rad/s^2], > 0.
    creep_m_s
        Slowest speed while the goal is not reached [m/s], > 0; a slower wanted speed holds.
    goal_tolerance_m
        The end is reached this far before it, along the path [m], > 0.
    off_path_max_m
        A robot further from its path gives up [m], > 0.
    turn_on_spot_deg, turned_deg
        A robot that can turn on the spot does so when the point lies further aside than the first
        [deg], until it lies within the second.

    Raises
    ------
    ValueError
        If a value is not positive and finite.
    """

    lookahead_s: float = 0.8
    lookahead_min_m: float = 0.25
    lookahead_max_m: float = 0.6
    acceleration_m_s2: float = 0.4
    lateral_acceleration_m_s2: float = 0.5
    omega_max_rad_s: float = 1.2
    alpha_rad_s2: float = 1.5
    creep_m_s: float = 0.06
    goal_tolerance_m: float = 0.05
    off_path_max_m: float = 0.5
    turn_on_spot_deg: float = 60.0
    turned_deg: float = 8.0

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if not 0.0 < value < math.inf:
                raise InvalidValue(each.name, f"{value} found, a finite number > 0 allowed", value)


@dataclass(frozen=True, slots=True)
class WallConfig:
    """How walls are followed.

    Parameters
    ----------
    length_m
        Way over which a wrong distance is corrected [m], > 0.
    omega_max_rad_s
        Fastest turn [rad/s], > 0.
    approach_max_deg
        Steepest approach to the wall [deg], in (0, 90).
    lost_max_m
        Distance driven straight on without a wall before giving up [m], > 0.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    length_m: float = 0.5
    omega_max_rad_s: float = 0.8
    approach_max_deg: float = 20.0
    lost_max_m: float = 0.8

    def __post_init__(self) -> None:
        for key in ("length_m", "omega_max_rad_s", "lost_max_m"):
            if not 0.0 < getattr(self, key) < math.inf:
                raise InvalidValue(
                    key, f"{getattr(self, key)} found, a number > 0 allowed", getattr(self, key)
                )
        if not 0.0 < self.approach_max_deg < 90.0:
            raise InvalidValue(
                "approach_max_deg",
                f"{self.approach_max_deg} found, (0, 90) allowed",
                self.approach_max_deg,
            )


@dataclass(frozen=True, slots=True)
class RecoveryConfig:
    """How patient journeys are.

    Parameters
    ----------
    wait_s
        Longest wait before a place where something that is on no map closes the way [s], 0 to
        86400; then it begins to recover.
    retries
        Times in one journey that it begins to recover, 0 to 1000; 0: it gives up at once.
    back_off_m
        Distance that it backs off [m], 0 to 5; 0: it drives back on no rung.
    ladder
        What it tries, one after the other, before it gives up.
    retrace_m
        Distance that it drives back by the way it came [m], 0.1 to 20, for `retrace`.
    ask_s
        Time for which it waits for an answer [s], 0 to 86400, for `ask`.
    people_s
        Time for which it begins its ladder anew, in place of giving up, while somebody has been
        near lately [s], 0 to 86400.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    wait_s: float = 30.0
    retries: int = 4
    back_off_m: float = 0.3
    ladder: tuple[RungName, ...] = (
        "wait",
        "replan",
        "clear",
        "back_off",
        "retrace",
        "other_way",
        "look_around",
    )
    retrace_m: float = 2.0
    ask_s: float = 120.0
    people_s: float = 60.0

    def __post_init__(self) -> None:
        for key, most in (
            ("wait_s", LONGEST_WAIT_S),
            ("retries", MOST_RETRIES),
            ("back_off_m", FARTHEST_BACK_M),
            ("ask_s", LONGEST_WAIT_S),
            ("people_s", LONGEST_WAIT_S),
        ):
            value = getattr(self, key)
            if not 0 <= value <= most:
                raise InvalidValue(key, f"{value} found, 0 to {most:g} allowed", value)
        check_ranges(self, retrace_m=(0.1, 20.0))


@dataclass(frozen=True, slots=True)
class JourneyConfig:
    """When journeys are planned again, and when they are in trouble.

    Parameters
    ----------
    replan_s
        Interval between two searches for a better path [s], > 0.
    better
        Share of the present path's cost below which another path replaces it, in (0, 1].
    off_path_m
        Distance from the path beyond which the robot plans from where it is [m], > 0.
    stuck_s
        Standing time after which a robot that wants to drive begins to recover [s], > 0.
    patience_s
        Standing time after which it does near a person, who is likely to move on [s], > 0.
    blind_max_s
        Time without a scan after which it gives up [s], > 0.
    turning_reserve
        Planned over minimum turning radius of a robot that steers, in [1, 10]: leaves room for
        corrections.
    rungs, people, exploration, travel
        How it tries to get on where it is in trouble, how it gives way to people, how it chooses
        frontiers, and how it travels by recognising places.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    replan_s: float = 1.0
    better: float = 0.9
    off_path_m: float = 0.6
    stuck_s: float = 1.5
    patience_s: float = 6.0
    blind_max_s: float = 10.0
    turning_reserve: float = 1.3
    rungs: RungsConfig = field(default_factory=RungsConfig)
    people: PeopleConfig = field(default_factory=PeopleConfig)
    exploration: ExplorationConfig = field(default_factory=ExplorationConfig)
    travel: TravelConfig = field(default_factory=TravelConfig)

    def __post_init__(self) -> None:
        for key in ("replan_s", "stuck_s", "patience_s", "blind_max_s"):
            value = getattr(self, key)
            if not 0.0 < value <= LONGEST_WAIT_S:
                allowed = f"above 0 to {LONGEST_WAIT_S:g} allowed"
                raise InvalidValue(key, f"{value} found, {allowed}", value)
        if not 0.0 < self.off_path_m < math.inf:
            raise InvalidValue(
                "off_path_m", f"{self.off_path_m} found, a number > 0 allowed", self.off_path_m
            )
        if not 0.0 < self.better <= 1.0:
            raise InvalidValue("better", f"{self.better} found, (0, 1] allowed", self.better)
        if not 1.0 <= self.turning_reserve <= MOST_RESERVE:
            raise InvalidValue(
                "turning_reserve",
                f"{self.turning_reserve} found, 1 to {MOST_RESERVE:g} allowed",
                self.turning_reserve,
            )


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
        Clearance between the body and obstacles on a planned path [m], >= 0.
    comfort_m
        Clearance beyond the margin below which a path counts longer [m], 0 to 10.
    comfort_weight
        Cost of a metre at the margin itself, beyond that of a free metre, 0 to 1000: larger, paths
        keep to the middle, and make detours for it.
    zone
        Parts of the world that the robot keeps out of, or passes slowly.
    mask
        Pictures of such parts.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    planner: str = ""
    controller: str = "mppi"
    topology: str = ""
    margin_m: float = 0.05
    comfort_m: float = 0.25
    comfort_weight: float = 2.0
    zone: tuple[Zone, ...] = ()
    mask: tuple[MaskConfig, ...] = ()

    def __post_init__(self) -> None:
        if not 0.0 <= self.margin_m < math.inf:
            raise InvalidValue(
                "margin_m", f"{self.margin_m} found, a number >= 0 allowed", self.margin_m
            )
        check_ranges(self, comfort_m=(0.0, 10.0), comfort_weight=(0.0, 1000.0))


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
    pursuit, guard, wall, pilot, map, follow, journey, recovery
        Following paths, minding obstacles, following walls, driving by plan, what sensors mark in
        the map that it plans on, how a planned path is followed round obstacles, when to plan
        again, and what to do where that does not get on.

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
    map: MapConfig = field(default_factory=MapConfig)
    follow: FollowConfig = field(default_factory=FollowConfig)
    journey: JourneyConfig = field(default_factory=JourneyConfig)
    recovery: RecoveryConfig = field(default_factory=RecoveryConfig)

    def __post_init__(self) -> None:
        if not 5.0 <= self.rate_hz <= 100.0:
            raise InvalidValue("rate_hz", f"{self.rate_hz} found, 5 to 100 allowed", self.rate_hz)
        for key in ("guided_speed_m_s", "return_speed_m_s", "look_around_speed_m_s"):
            if not 0.0 < getattr(self, key) < math.inf:
                raise InvalidValue(
                    key, f"{getattr(self, key)} found, a number > 0 allowed", getattr(self, key)
                )
        if self.follow.tau_s <= 1.0 / self.rate_hz:
            raise InvalidValue(
                "follow.tau_s",
                f"{self.follow.tau_s} found, more than a step of 1 / rate_hz allowed",
                self.follow.tau_s,
            )
