"""The pilot: a live world, a planner and a local controller, put together for one robot."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from robotctl.control.limiter import LimitsConfig
from robotctl.errors import InvalidValue
from robotctl.model.drives.drives import Drive
from robotctl.model.fence import Fence
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.behave.behaviours.kind import UNHURRIED, Pace
from robotctl.planning.behave.behaviours.outlook import NOWHERE, Outlook
from robotctl.planning.behave.journey.approach import Approach
from robotctl.planning.behave.journey.exploration import Exploration
from robotctl.planning.behave.journey.journey import Journey
from robotctl.planning.behave.journey.place_finder import KnownPlaces
from robotctl.planning.behave.journey.tools import JourneyTools
from robotctl.planning.behave.journey.travel import Travel
from robotctl.planning.behave.journey.warm_up import warm_up
from robotctl.planning.config import NavigationConfig, RecoveryConfig
from robotctl.planning.map.costs import costs_of
from robotctl.planning.map.doors import doors_of
from robotctl.planning.map.live_world import LiveWorld
from robotctl.planning.map.mask import Mask
from robotctl.planning.map.seen import Seen
from robotctl.planning.map.topological.graph import TopologicalMap
from robotctl.planning.map.zone import Zone
from robotctl.planning.map.zones import Closed
from robotctl.planning.path.global_planning.goal import Goal
from robotctl.planning.path.global_planning.path_finder import PathFinder
from robotctl.planning.path.global_planning.plan import GoesOn, Planner
from robotctl.planning.path.global_planning.planners import (
    PLANNERS,
    planner_config,
    planner_of,
)
from robotctl.planning.path.local.controller import ControllerConfig
from robotctl.planning.path.local.controllers import CONTROLLERS


class MapPilot:
    """Makes the behaviours that drive by plan, and lets them see.

    Parameters
    ----------
    config
        Of the navigator.
    drive, limits, footprint, mounts
        Of the robot; the sonars in the order of the ranges.
    grid
        The map that the robot localises itself in; None: it has none, and may pass where it has
        seen nothing.
    home
        Where it starts.
    lidars
        Number of its lidars, without whose scans it stands.
    topology
        Places that it can drive to by recognising them; None: it knows none.
    masks
        Pictures of where it keeps out, or drives slowly.
    budget
        Called at each step; returns what its searches ask now and then, whether there is time left.
    pace
        Told of the parts of its steps, and asked how much it may do in them.

    Attributes
    ----------
    tools
        What all its behaviours drive with.

    Raises
    ------
    InvalidValue
        If there is no such planner or controller.
    """

    def __init__(
        self,
        config: NavigationConfig,
        drive: Drive,
        limits: LimitsConfig,
        footprint: Footprint,
        mounts: tuple[SonarMount, ...],
        grid: GridMap | None,
        home: SE2,
        *,
        lidars: int,
        topology: TopologicalMap | None = None,
        masks: Sequence[Mask] = (),
        budget: Callable[[], GoesOn] = lambda: lambda: True,
        pace: Pace = UNHURRIED,
    ) -> None:
        radius_m = config.journey.turning_reserve * drive.min_turning_radius_m
        world = LiveWorld(
            footprint,
            mounts,
            grid,
            home,
            Closed(
                config.pilot.zone,
                masks=tuple(masks),
                doors=doors_of(grid, footprint.inscribed_m, config.journey.people.door_m),
            ),
            config.map,
            full_speed_m_s=limits.v_max_m_s,
            braking_m_s2=config.pursuit.acceleration_m_s2,
            lidars=lidars,
        )
        make_planner = _entry("planner", planner_of(config.pilot, drive), PLANNERS)

        def planner(body: Footprint) -> Planner:
            return make_planner(planner_config(config.pilot, drive, body, radius_m))

        local = ControllerConfig.of_robot(
            config.follow,
            dt_s=1.0 / config.rate_hz,
            deceleration_m_s2=config.guard.deceleration_m_s2,
            margin_m=config.pilot.margin_m,
        )
        make_controller = _entry("controller", config.pilot.controller, CONTROLLERS)
        self._make_planner = planner
        self._make_controller = partial(make_controller, local, drive, limits)
        self.tools = JourneyTools(
            world,
            PathFinder(
                self._make_planner(footprint),
                world,
                budget,
                steered=drive.steered,
                turning_radius_m=radius_m,
                queue_m=config.journey.people.queue_m,
            ),
            self._make_controller(footprint),
            local,
            config.journey,
            config.recovery,
            pace,
        )
        self._own_recovery = config.recovery
        self._mission_zones: Sequence[Zone] = ()
        self._drawn_zones: Sequence[Zone] = ()
        self._places = None if topology is None else KnownPlaces(topology)
        self._here = home
        self._masks = tuple(masks)
        self._done = (0, 0)
        """Paths taken and recoveries on the journeys before the present one."""
        self._journey: Journey | None = None

    def warm_up(self) -> None:
        """Plan and drive a step on a small map, so that all is compiled before the robot moves."""
        warm_up(self.tools.paths.planner, self.tools.controller, self.tools.world.body)
        if self._places is not None:
            _ = self._places.looks

    @property
    def plans(self) -> int:
        """Paths taken since the start."""
        return self._done[0] + (self._journey.plans if self._journey else 0)

    @property
    def recoveries(self) -> int:
        """Tries to get on again since the start."""
        return self._done[1] + (self._journey.recoveries if self._journey else 0)

    @property
    def knows_ways(self) -> bool:
        """Whether it has a map, or a lidar that shows the way; else only sonars."""
        return self.tools.world.knows_ways

    @property
    def may_move(self) -> tuple[bool, ...]:
        """Whether the last two echoes of each sonar are of something that was not there before."""
        return self.tools.world.may_move

    @property
    def moving(self) -> NDArray[np.float64]:
        """Things that a lidar sees move, (k, 5), as `LocalSituation.moving`."""
        return self.tools.world.moving

    @property
    def areas(self) -> tuple[str, ...]:
        """Names of the areas of binary masks that `base` is in."""
        x_m, y_m = self._here.x_m, self._here.y_m
        return tuple(mask.config.name for mask in self._masks if mask.has(x_m, y_m))

    def see(self, pose: SE2, seen: Seen, now_ns: int) -> None:
        """Take in what was seen; `pose` is that of `base` in `world` now."""
        self._here = pose
        self.tools.shown = NOWHERE, NOWHERE
        self.tools.paths.begin_step()
        self.tools.world.see(pose, seen, now_ns)

    def outlook(self) -> Outlook:
        """Return what it drives by and sees now."""
        world, (path, arc) = self.tools.world, self.tools.shown
        costs = costs_of(world.space_around(self._here), self.tools.config.comfort_m)
        return Outlook(path, arc, world.map.marked_world(), world.moving, costs)

    def use_zones(self, zones: Sequence[Zone]) -> None:
        """Take the zones of another mission; what was seen is forgotten where they differ."""
        self._mission_zones = zones
        self._use_all_zones()

    def use_drawn_zones(self, zones: Sequence[Zone]) -> None:
        """Take the zones that people have drawn, in place of those drawn before."""
        self._drawn_zones = zones
        self._use_all_zones()

    def _use_all_zones(self) -> None:
        self.tools.world.use_zones((*self._mission_zones, *self._drawn_zones))

    def use_fence(self, fence: Fence) -> None:
        """Plan within another fence; what was seen is forgotten where it differs."""
        self.tools.world.use_fence(fence)

    def use_body(self, footprint: Footprint) -> None:
        """Plan and drive with another body from now on; what was seen stays known."""
        self.tools.world.use_body(footprint)
        self.tools.paths.planner = self._make_planner(footprint)
        self.tools.controller = self._make_controller(footprint)

    def use_recovery(self, recovery: RecoveryConfig | None) -> None:
        """Be as patient as a mission says; None: as the robot's file does."""
        self.tools.recovery = recovery or self._own_recovery

    def use_reverse(self, *, reverse: bool) -> None:
        """Plan for a robot that drives in reverse from now on, or ahead again."""
        self.tools.paths.reverse = reverse

    def forget(self) -> None:
        """Forget what was seen: the robot's pose in `world` has jumped."""
        self.tools.world.forget()

    def recall(self, grid: GridMap) -> None:
        """Know what a map knows that the robot has made, in place of what was seen so far."""
        self.tools.world.recall(grid)

    def journey(self, goal: Goal, speed_m_s: float) -> Journey:
        """Return the behaviour that drives to a goal."""
        self._done = self.plans, self.recoveries
        self.tools.world.begin_journey()
        self._journey = Journey(self.tools, goal, speed_m_s)
        return self._journey

    def exploration(self, speed_m_s: float) -> Exploration:
        """Return the behaviour that drives to what is unknown."""
        return Exploration(self.tools, self.journey, speed_m_s)

    def travel(self, place: str, start: str, speed_m_s: float) -> Travel:
        """Return the behaviour that drives to a place by recognising places; "": any start."""
        if self._places is None:
            raise ValueError("the pilot has no topological map")
        return Travel(
            self.tools,
            self._places,
            Approach(self.tools.world, self.journey, speed_m_s, self.tools.journey.travel),
            partial(self.exploration, speed_m_s),
            place,
            start,
        )


_T = TypeVar("_T")


def _entry(key: str, name: str, entries: Mapping[str, _T]) -> _T:
    """Return an entry of a registry; `InvalidValue`: there is none of that name."""
    if name not in entries:
        raise InvalidValue(key, f"{name} found; allowed are {', '.join(entries)}", name)
    return entries[name]
