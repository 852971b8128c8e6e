"""The pilot: a live map, a planner and a local controller, put together for one robot."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.control.limiter import LimitsConfig
from robotctl.errors import InvalidValue
from robotctl.model.drives.drives import Drive
from robotctl.model.fence import Fence
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.behaviours.kind import Goal, Seen
from robotctl.planning.behaviours.outlook import NOWHERE, Outlook
from robotctl.planning.config import NavigationConfig
from robotctl.planning.costmap.costs import costs_of
from robotctl.planning.costmap.layered_map import FARTHEST_M, NOTHING_MOVES, LayeredMap
from robotctl.planning.costmap.layers_config import LayersConfig
from robotctl.planning.costmap.planning_map import PlanningMap, clearance_of
from robotctl.planning.costmap.tracks import MovingObstacles
from robotctl.planning.costmap.zone import Zone
from robotctl.planning.costmap.zones import Closed
from robotctl.planning.global_planning.frontiers import connected
from robotctl.planning.global_planning.obstructions import blocked_goal, nearest
from robotctl.planning.global_planning.plan import (
    GoesOn,
    Plan,
    PlanFailure,
    PlannerConfig,
    dense,
    facing,
)
from robotctl.planning.global_planning.planners import PLANNERS
from robotctl.planning.journey.arc import arc_to
from robotctl.planning.journey.closed_way import ClosedWay, priced, until_closed
from robotctl.planning.journey.exploration import Exploration
from robotctl.planning.journey.journey import Journey
from robotctl.planning.journey.recovery import RecoveryConfig
from robotctl.planning.journey.rehearsal import rehearse
from robotctl.planning.journey.travel import KnownPlaces, Travel
from robotctl.planning.journey.way_out import find_way, lead_out
from robotctl.planning.local.controller import ControllerConfig
from robotctl.planning.local.controllers import CONTROLLERS
from robotctl.planning.topological.graph import TopologicalMap

_BLIND_NS: Final = 500_000_000
"""Maximum age of the last scan with which a robot that has a lidar drives [ns]."""
_AGREE: Final = 2
"""One echo alone may have nothing to do with the world."""
_SOMEBODY_M: Final = 2.0
_LATELY_NS: Final = 1_000_000_000
_LOOK_M: Final = 4.0
"""Half of the side of the map that the controller gets [m]."""
_WIDER: Final = 1.3
"""Planned over minimum turning radius: leaves room for corrections."""
_STAGE_M: Final = 25.0
"""Maximum length of a plan towards a goal beyond what a robot without a map has seen [m]."""
_LOOKS_M: Final = 5.0
"""Range within which the robot sees most of what stands there [m]."""
_CELL_M: Final = 0.05
"""Cell of a map that the robot makes itself [m]."""
_TURNED: Final = SE2(0.0, 0.0, math.pi)
_AROUND_M: Final = 20.0
"""Margin of such a map around goals, and around the robot whenever it comes near the edge [m]."""


class MapPilot:
    """Plans on a live map.

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
    has_lidar
        Whether it has one, without whose scans it stands.
    topology
        Places that it can drive to by recognising them; None: it knows none.
    budget
        Called at each step; returns what its searches ask now and then, whether there is time left.

    Attributes
    ----------
    config, controller
        The local controller, and its settings.
    recovery
        How patient journeys are.
    steered, turning_radius_m
        Whether the robot steers, and the radius that its paths are planned with [m]; else 0.
    reverse
        Whether journeys are driven in reverse; not where the robot steers.
    moving
        (k, 5) what moves by itself, as `LocalSituation.moving`.
    last_scan
        The last scan of the lidar with `base` in `world` at its time; None: there is none yet.

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
        has_lidar: bool,
        topology: TopologicalMap | None = None,
        budget: Callable[[], GoesOn] = lambda: lambda: True,
    ) -> None:
        wanted = config.pilot
        planner = wanted.planner or ("hybrid" if drive.steered else "astar")
        for key, name, names in (
            ("planner", planner, PLANNERS),
            ("controller", wanted.controller, CONTROLLERS),
        ):
            if name not in names:
                allowed = ", ".join(names)
                raise InvalidValue(key, f"{name} found; allowed are {allowed}", name)
        self.steered = drive.steered
        self.turning_radius_m = _WIDER * drive.min_turning_radius_m
        self.reverse = False
        self._own_recovery = self.recovery = config.recovery
        self._own_zones = wanted.zone
        self._mission_zones: Sequence[Zone] = ()
        self._drawn_zones: Sequence[Zone] = ()
        self._closed = Closed(wanted.zone)
        self._footprint = footprint
        self._mounts = mounts
        self._grid = grid
        self._has_lidar = has_lidar
        self._budget = budget
        self._goes_on = budget()
        self._full_speed_m_s = limits.v_max_m_s
        self._braking_m_s2 = config.pursuit.acceleration_m_s2
        paths = PlannerConfig(
            margin_m=wanted.margin_m,
            turning_radius_m=self.turning_radius_m or 2.0 * footprint.inscribed_m,
            steering="reeds-shepp" if drive.steered else "straight",
        )
        self._planner = PLANNERS[planner](paths)
        self.config = ControllerConfig(
            dt_s=1.0 / config.rate_hz,
            deceleration_m_s2=config.guard.deceleration_m_s2,
            margin_m=wanted.margin_m,
        )
        self.controller = CONTROLLERS[wanted.controller](self.config, drive, limits, footprint)
        self.moving = NOTHING_MOVES
        self._new_echoes = [0] * len(mounts)
        self._map = self._around(home) if grid is None else self._with_map(grid)
        self._given = self._map.space()
        """The map as given, with nothing seen yet."""
        self._tracks = MovingObstacles()
        self._scan_ns = -1
        self.last_scan: tuple[SE2, RangeScan] | None = None
        self._places = None if topology is None else KnownPlaces(topology)
        self._now_ns = 0
        self._here = home
        self._shown = NOWHERE, NOWHERE
        self._shown_ns = -1
        self._done = (0, 0)
        self._once_marked = self._map.marked()
        """Cells that were marked on this journey, (rows, columns); with a map."""
        self._journey: Journey | None = None

    def warm_up(self) -> None:
        """Plan and drive a step on a small map, so that all is compiled before the robot moves."""
        rehearse(self._planner, self.controller, self._footprint)
        if self._places is not None:
            self._places.warm_up()

    @property
    def plans(self) -> int:
        """Paths taken since the start."""
        return self._done[0] + (self._journey.plans if self._journey else 0)

    @property
    def recoveries(self) -> int:
        """Tries to get on again since the start."""
        return self._done[1] + (self._journey.recoveries if self._journey else 0)

    def _with_map(self, grid: GridMap) -> LayeredMap:
        return LayeredMap(
            grid,
            self._footprint,
            LayersConfig(),
            self._closed,
            self._full_speed_m_s,
        )

    def _around(self, pose: SE2) -> LayeredMap:
        """Return a map of which nothing is known."""
        low, high = _beside(pose).tolist()
        return LayeredMap.without_map(
            (low[0], low[1]),
            (high[0], high[1]),
            _CELL_M,
            self._footprint,
            self._closed,
            self._full_speed_m_s,
        )

    def see(self, pose: SE2, seen: Seen, now_ns: int) -> None:
        """Take in what was seen; `pose` is that of `base` in `world` now."""
        self._here, self._now_ns, self._goes_on = pose, now_ns, self._budget()
        if self._grid is None and self._map.room_m(pose) < FARTHEST_M:
            self._map = self._map.grown(_beside(pose))
        self._map.close_behind(pose)
        self._map.stand_at(pose)
        for T_odom_base, scan in seen.scans:
            if scan.stamp_ns > self._scan_ns:
                self._scan_ns = scan.stamp_ns
                self._take(seen.T_world_odom, T_odom_base, scan)
        if not self._sees_by_lidar:
            self._hear(pose, seen.ranges_m, now_ns)
        self._map.see_floor(pose, seen.floor_base, now_ns)

    def _hear(self, pose: SE2, ranges_m: Sequence[float], now_ns: int) -> None:
        """Take echoes of sonars."""
        stand = self._map.see_echoes(pose, self._mounts, ranges_m, now_ns)
        for i, (range_m, stands) in enumerate(zip(ranges_m, stand, strict=True)):
            if not math.isnan(range_m):
                self._new_echoes[i] = 0 if stands else self._new_echoes[i] + 1

    @property
    def may_move(self) -> tuple[bool, ...]:
        """Whether the last two echoes of each sonar are of something that was not there before."""
        return tuple(count >= _AGREE for count in self._new_echoes)

    def is_somebody_near(self, pose: SE2) -> bool:
        """Return whether something that moves, or may move, is near a pose."""
        away_m = np.hypot(self.moving[:, 0] - pose.x_m, self.moving[:, 1] - pose.y_m)
        return any(self.may_move) or bool((away_m < _SOMEBODY_M).any())

    def _take(self, T_world_odom: SE2, T_odom_base: SE2, scan: RangeScan) -> None:
        """Take a scan: moving things are tracked, the rest is marked in the map."""
        where = T_world_odom @ T_odom_base
        self.last_scan = where, scan
        angles = where.theta_rad + scan.angles_rad
        sensor = where @ SE2(scan.x_m, scan.y_m, 0.0)
        ranges = np.where(np.isfinite(scan.ranges_m), scan.ranges_m, 0.0)[:, np.newaxis]
        ends = (sensor.x_m, sensor.y_m) + ranges * np.stack([np.cos(angles), np.sin(angles)], 1)
        self._tracks.step(T_odom_base, scan, scan.stamp_ns, ~self._map.explained(ends))
        self.moving = self._tracks.moving(T_world_odom)
        self._map.see_scan(where, scan, scan.stamp_ns, self.moving)

    def show(self, path: NDArray[np.float64], arc: NDArray[np.float64]) -> None:
        """Note what the robot drives by in this step, for `outlook`."""
        self._shown, self._shown_ns = (path, arc), self._now_ns

    def outlook(self) -> Outlook:
        """Return what it drives by and sees now."""
        path, arc = self._shown if self._shown_ns == self._now_ns else (NOWHERE, NOWHERE)
        return Outlook(
            path,
            arc,
            self._map.marked_world(),
            self.moving,
            costs_of(self._map.space_around(self._here, _LOOK_M), self.config.comfort_m),
        )

    def use_zones(self, zones: Sequence[Zone]) -> None:
        """Take the zones of another mission; what was seen is forgotten where they differ."""
        self._mission_zones = zones
        self._use_all_zones()

    def use_drawn_zones(self, zones: Sequence[Zone]) -> None:
        """Take the zones that people have drawn, in place of those drawn before."""
        self._drawn_zones = zones
        self._use_all_zones()

    def _use_all_zones(self) -> None:
        zones = (*self._own_zones, *self._mission_zones, *self._drawn_zones)
        self._close(Closed(zones, self._closed.fence))

    def use_recovery(self, recovery: RecoveryConfig | None) -> None:
        """Be as patient as a mission says; None: as the robot's file does."""
        self.recovery = recovery or self._own_recovery

    def use_fence(self, fence: Fence) -> None:
        """Plan within another fence; what was seen is forgotten where it differs."""
        self._close(Closed(self._closed.zones, fence))

    def _close(self, closed: Closed) -> None:
        """Take other bounds of where the robot may be."""
        if closed == self._closed:
            return
        self._closed = closed
        grid = self._grid
        self._map = self._around(self._here) if grid is None else self._with_map(grid)
        self._given = self._map.space()
        self.forget()

    def forget(self) -> None:
        """Forget what was seen: the robot's pose in `world` has jumped."""
        self._map.forget()
        self._once_marked[:] = False
        self._tracks.reset()
        self.last_scan = None
        self.moving = NOTHING_MOVES

    def recall(self, grid: GridMap) -> None:
        """Know what a map knows that the robot has made, in place of what was seen so far."""
        self.forget()
        if self._grid is None:
            rows, columns = grid.shape
            corners = grid.centre_of(np.array([[0, 0], [0, columns], [rows, 0], [rows, columns]]))
            self._map = self._map.grown(corners)
            self._map.recall(grid, self._now_ns)

    def forget_unseen(self) -> None:
        """Forget obstacles that no sensor has seen lately."""
        self._map.forget_unseen(self._now_ns - _LATELY_NS)

    def journey(self, goal: Goal, speed_m_s: float) -> Journey:
        """Return the behaviour that drives to a goal."""
        self._done = self.plans, self.recoveries
        self._once_marked[:] = False
        self._journey = Journey(self, goal, speed_m_s)
        return self._journey

    def exploration(self, speed_m_s: float) -> Exploration:
        """Return the behaviour that drives to what is unknown."""
        return Exploration(self, speed_m_s)

    def travel(self, place: str, start: str, speed_m_s: float) -> Travel:
        """Return the behaviour that drives to a place by recognising places; "": any start."""
        if self._places is None:
            raise ValueError("the pilot has no topological map")
        return self._places.travel(self, place, start, speed_m_s)

    @property
    def has_time(self) -> bool:
        """Whether there is time left in this step."""
        return self._goes_on()

    @property
    def knows_ways(self) -> bool:
        """Whether it has a map, or a lidar that shows the way; else only sonars."""
        return self._grid is not None or self._sees_by_lidar

    @property
    def _sees_by_lidar(self) -> bool:
        """Whether there is a lidar, in the robot's file or heard by now."""
        return self._has_lidar or self._scan_ns >= 0

    @property
    def blindness(self) -> str:
        """Why the robot must not drive on what it sees; empty if it may."""
        if self._sees_by_lidar and self._now_ns - self._scan_ns > _BLIND_NS:
            return "the lidar gives no scans"
        return ""

    def use_reverse(self, *, reverse: bool) -> None:
        """Plan for a robot that drives in reverse from now on, or ahead again."""
        self.reverse = reverse

    def plan(self, pose: SE2, goal: Goal) -> Plan | PlanFailure:
        """Return the path from a pose to a goal through what is known now."""
        if self._grid is not None:
            self._once_marked |= self._map.marked()
        if not self.reverse:
            return self._plan_ahead(pose, goal)
        # A robot that turns on the spot drives any path in reverse, once it is turned round.
        plan = self._plan_ahead(pose @ _TURNED, _opposite(goal))
        return plan if isinstance(plan, PlanFailure) else _turned_round(plan)

    def _plan_ahead(self, pose: SE2, goal: Goal) -> Plan | PlanFailure:
        """Return the same of a robot that drives ahead."""
        if self.is_far(pose, goal):
            return self._way(*self._stage(pose, goal))
        there = _as_pose(pose, goal)
        if not self._holds(goal):
            self._map = self._map.grown(_beside(there))
        if self._map.closed_at(pose):
            return self._lead_out(pose, there)
        return self._way(self._map.space(), pose, there)

    def _lead_out(self, pose: SE2, goal: SE2) -> Plan | PlanFailure:
        """Return the shortest path out of what the robot should keep out of."""
        if failure := blocked_goal(self._given, goal):
            return failure
        outside = self._map.room_outside()
        wide = self._given.clearance >= self._given.inscribed
        beyond = outside & connected(self._given, wide, (goal.x_m, goal.y_m))
        self._map.open_around(pose)
        space = self._map.space()
        exits = beyond if beyond.any() else outside
        return lead_out(space, exits, pose, lambda exit_: self._way(space, pose, exit_))

    def closed_at(self, pose: SE2) -> str:
        """Return the name of the zone or fence that a robot stands in or beyond; else ""."""
        return self._map.closed_at(pose)

    def arc_to(self, pose: SE2, goal: Goal) -> Plan | None:
        """Return the free arc of a robot that steers to a goal ahead of it; None: there is none."""
        arc = arc_to(pose, goal, self.turning_radius_m) if self.steered else None
        return None if arc is None or self.touches(arc.poses) else arc

    def is_far(self, pose: SE2, goal: Goal) -> bool:
        """Whether a goal is so far beyond what is known that paths lead only towards it."""
        away_m = math.dist((pose.x_m, pose.y_m), (goal.x_m, goal.y_m))
        return away_m > _STAGE_M and not self._holds(goal)

    def _holds(self, goal: Goal) -> bool:
        """Return whether a goal is on the map, or no map can be made that has it."""
        return self._grid is not None or self._map.room_m(SE2(goal.x_m, goal.y_m, 0.0)) > 0.0

    def _stage(self, pose: SE2, goal: Goal) -> tuple[PlanningMap, SE2, SE2]:
        """Return the map, a pose, and a place with room on the straight line to a goal far away."""
        there = facing(pose, goal.x_m, goal.y_m)
        stage = SE2(pose.x_m, pose.y_m, there.theta_rad) @ SE2(_STAGE_M, 0.0, 0.0)
        self._map = self._map.grown(_beside(stage))
        space = self._map.space()
        roomy = space.clearance >= space.circumscribed
        if not space.has_room_at(stage) and roomy.any():
            stage = facing(pose, *nearest(space, roomy, space.to_cells(stage)))
        return space, pose, stage

    def _way(self, space: PlanningMap, start: SE2, goal: SE2) -> Plan | PlanFailure:
        """Return a path that the robot can take from where it is."""
        return find_way(self._planner, space, start, goal, self._goes_on, steered=self.steered)

    def is_doubtful(self, plan: Plan, pose: SE2) -> bool:
        """Return whether a path leads far away through what was forgotten on this journey.

        Where the robot does not look now, what it has seen there may stand there still. Without
        that it would turn back on a long way round, again and again.
        """
        if self._grid is None:
            return False
        live = self._map.space()
        forgotten = self._once_marked & ~live.blocked
        if not forgotten.any():
            return False
        places = dense(plan.poses, live.grid.resolution_m)
        far = np.hypot(*(places[:, :2] - (pose.x_m, pose.y_m)).T) > _LOOKS_M
        live.blocked, live.clearance = forgotten, clearance_of(forgotten)
        return bool(live.collides(live.poses_to_cells(places[far])).any())

    def closed_way(self, pose: SE2, goal: Goal) -> ClosedWay | PlanFailure | None:
        """Return how far the way is free that leads there if nothing but the map were there.

        None: nothing closes it, or the robot has no map.
        """
        if self._grid is None:
            return None
        begin, there = (pose @ _TURNED, _opposite(goal)) if self.reverse else (pose, goal)
        live = self._map.space()
        aim = _as_pose(begin, there)
        if failure := blocked_goal(self._given, aim):
            return failure
        answer = self._way(priced(self._given, live), begin, aim)
        if isinstance(answer, PlanFailure):
            return answer
        if self.reverse:
            answer = _turned_round(answer)
        return until_closed(answer, self._given, live, self.moving)

    def space(self) -> PlanningMap:
        """Return all that is known now."""
        return self._map.space()

    def touches(self, poses: NDArray[np.float64]) -> bool:
        """Return whether the body touches something at one of the poses (n, 3) of `world`."""
        return bool(len(poses)) and bool(self._map.collides(poses).any())

    def is_known(self, poses: NDArray[np.float64]) -> bool:
        """Return whether all under the body at poses (n, 3) of `world` is known."""
        return self._map.is_known(poses)

    def space_around(self, pose: SE2) -> PlanningMap:
        """Return what the local controller looks at."""
        return self._map.space_around(pose, _LOOK_M)

    def speed_limit(self, pose: SE2, path: NDArray[np.float64]) -> float:
        """Return the speed that keeps the limits of slow zones [m/s], here and as the robot brakes.

        `path` is what lies ahead, places (n, 3) of `world`; inf: no zone limits it.
        """
        places = np.vstack([(pose.x_m, pose.y_m), path[:, :2]])
        away_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(places, axis=0).T))])
        limits_m_s = self._map.speed_limits_at(places)
        return float(np.sqrt(limits_m_s**2 + 2.0 * self._braking_m_s2 * away_m).min())


def _beside(pose: SE2) -> NDArray[np.float64]:
    """Return the corners of a square around a pose, (2, 2) [m]."""
    return np.array([(pose.x_m + away_m, pose.y_m + away_m) for away_m in (-_AROUND_M, _AROUND_M)])


def _opposite(goal: Goal) -> Goal:
    """Return a goal with the heading of a robot that is turned round."""
    if goal.heading_rad is None:
        return goal
    return goal._replace(heading_rad=goal.heading_rad + math.pi)


def _turned_round(plan: Plan) -> Plan:
    """Return a path to be driven in the other gear."""
    half_turn = np.array([0.0, 0.0, math.pi])
    return replace(plan, poses=plan.poses + half_turn, reverse=~plan.reverse)


def _as_pose(pose: SE2, goal: Goal) -> SE2:
    """Return a goal as a pose: where any heading will do, that in which the robot would come."""
    if goal.heading_rad is None:
        return facing(pose, goal.x_m, goal.y_m)
    return SE2(goal.x_m, goal.y_m, goal.heading_rad)
