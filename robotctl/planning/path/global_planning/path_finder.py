"""Paths of one robot through what it knows of the world: to a goal, towards it, and out again."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.se2 import SE2
from robotctl.planning.map.discs import Disc, close_disc, raise_in_disc
from robotctl.planning.map.live_world import LiveWorld
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.path.global_planning.arc import arc_to
from robotctl.planning.path.global_planning.closed_way import ClosedWay, priced, until_closed
from robotctl.planning.path.global_planning.frontiers import connected
from robotctl.planning.path.global_planning.goal import Goal, facing
from robotctl.planning.path.global_planning.obstructions import blocked_goal, nearest
from robotctl.planning.path.global_planning.plan import (
    GoesOn,
    Plan,
    PlanFailure,
    Planner,
    Point,
    Reason,
    dense,
)
from robotctl.planning.path.global_planning.way_out import find_way, lead_out

_STAGE_M: Final = 25.0
"""Maximum length of a plan towards a goal beyond what a robot without a map has seen [m]."""
_LOOKS_M: Final = 5.0
"""Range within which the robot sees most of what stands there [m]."""
_TURNED: Final = SE2(0.0, 0.0, math.pi)
_AVOIDED_M: Final = 0.5
"""Radius of a place that is avoided [m]."""
_ROOM_M: Final = 0.1
"""Clearance that a robot beside such a place keeps [m]."""
_BETWEEN: Final = 10.0
"""Price of a metre between two people who stand together, in metres elsewhere."""
_STEP_M: Final = 0.05
"""Step at which a path is checked for people [m]."""


class PathFinder:
    """Plans paths.

    Parameters
    ----------
    planner
        Searches the map; a robot whose body changes gets another one.
    world
        What is known.
    steered, turning_radius_m
        Whether the robot steers, and the radius that its paths are planned with [m].
    queue_m
        As in `PeopleConfig`.
    budget
        Called at each step; returns what its searches ask now and then, whether there is time left.

    Attributes
    ----------
    reverse
        Whether paths are driven in reverse; not where the robot steers.
    """

    def __init__(
        self,
        planner: Planner,
        world: LiveWorld,
        budget: Callable[[], GoesOn],
        *,
        steered: bool,
        turning_radius_m: float,
        queue_m: float,
    ) -> None:
        self.planner = planner
        self._world = world
        self._budget = budget
        self._goes_on = budget()
        self.steered = steered
        self.turning_radius_m = turning_radius_m
        self._queue_m = queue_m
        self.reverse = False
        self._avoided: list[Point] = []

    def begin_journey(self) -> None:
        """Avoid no place any more."""
        self._avoided.clear()

    def avoid(self, place: Point) -> None:
        """Pass a place in `world` [m] on this journey only if there is no other way."""
        self._avoided.append(place)

    def begin_step(self) -> None:
        """Count the time of another step."""
        self._goes_on = self._budget()

    @property
    def has_time(self) -> bool:
        """Whether there is time left in this step."""
        return self._goes_on()

    def plan(self, pose: SE2, goal: Goal) -> Plan | PlanFailure:
        """Return the path from a pose to a goal through what is known now."""
        self._world.note_marks()
        if not self.reverse:
            return self._plan_ahead(pose, goal)
        # A robot that turns on the spot drives any path in reverse, once it is turned round.
        plan = self._plan_ahead(pose @ _TURNED, goal.opposite)
        return plan if isinstance(plan, PlanFailure) else _turned_round(plan)

    def _plan_ahead(self, pose: SE2, goal: Goal) -> Plan | PlanFailure:
        """Return the same of a robot that drives ahead."""
        if self.is_far(pose, goal):
            return self._way(*self._stage(pose, goal))
        there = goal.seen_from(pose)
        if not self._world.holds(there):
            self._world.grow_to(there)
        if self._world.map.shut.closed_at(pose):
            return self._lead_out(pose, there)
        space = self._world.map.space()
        answer = self._way(space, pose, there)
        if isinstance(answer, PlanFailure) and answer.reason is Reason.GOAL_BLOCKED:
            beside = self._free_beside(space, there, goal.tolerance_m or 0.0)
            answer = answer if beside is None else self._way(space, pose, beside)
        return answer

    @staticmethod
    def _free_beside(space: PlanningMap, goal: SE2, tolerance_m: float) -> SE2 | None:
        """Return the pose nearest to a goal in which the robot can stand; None: it is too far."""
        roomy = space.clearance >= space.circumscribed
        if tolerance_m <= 0.0 or not roomy.any():
            return None
        x_m, y_m = nearest(space, roomy, space.to_cells(goal))
        is_near = math.dist((x_m, y_m), (goal.x_m, goal.y_m)) <= tolerance_m
        return SE2(x_m, y_m, goal.theta_rad) if is_near else None

    def _lead_out(self, pose: SE2, goal: SE2) -> Plan | PlanFailure:
        """Return the shortest path out of what the robot should keep out of."""
        given, live = self._world.given, self._world.map
        if failure := blocked_goal(given, goal):
            return failure
        outside = live.shut.room_outside(live.space())
        wide = given.clearance >= given.inscribed
        beyond = outside & connected(given, wide, (goal.x_m, goal.y_m))
        live.shut.open_around(pose)
        space = live.space()
        exits = beyond if beyond.any() else outside
        return lead_out(space, exits, pose, lambda exit_: self._way(space, pose, exit_))

    def is_far(self, pose: SE2, goal: Goal) -> bool:
        """Whether a goal is so far beyond what is known that paths lead only towards it."""
        away_m = math.dist((pose.x_m, pose.y_m), goal[:2])
        return away_m > _STAGE_M and not self._world.holds(goal.seen_from(pose))

    def _stage(self, pose: SE2, goal: Goal) -> tuple[PlanningMap, SE2, SE2]:
        """Return the map, a pose, and a place with room on the straight line to a goal far away."""
        there = facing(pose, goal.x_m, goal.y_m)
        stage = SE2(pose.x_m, pose.y_m, there.theta_rad) @ SE2(_STAGE_M, 0.0, 0.0)
        self._world.grow_to(stage)
        space = self._world.map.space()
        roomy = space.clearance >= space.circumscribed
        if not space.has_room_at(stage) and roomy.any():
            stage = facing(pose, *nearest(space, roomy, space.to_cells(stage)))
        return space, pose, stage

    def _way(self, space: PlanningMap, start: SE2, goal: SE2) -> Plan | PlanFailure:
        """Return a path that the robot can take from where it is."""
        space = self._round_people(space)
        plan = partial(find_way, self.planner, goes_on=self._goes_on, steered=self.steered)
        if self._avoided:
            answer = plan(self._without_avoided(space, start, goal), start, goal)
            if not isinstance(answer, PlanFailure):
                return answer
            if answer.reason is Reason.OUT_OF_TIME:  # the next search would take as long
                self._avoided.clear()
        return plan(space, start, goal)

    def _round_people(self, space: PlanningMap) -> PlanningMap:
        """Return a map on which paths between people who stand together cost much."""
        gaps = self._gaps()
        if not len(gaps):
            return space
        space = copy.copy(space)
        space.slowness = space.zone_prices().copy()
        for x_m, y_m, radius_m in gaps.tolist():
            raise_in_disc(space.slowness, _disc(space, (x_m, y_m), radius_m), _BETWEEN)
        return space

    def _without_avoided(self, space: PlanningMap, *ends: SE2) -> PlanningMap:
        """Return a map on which places that are avoided are closed, with room around the ends."""
        space = copy.copy(space)
        space.blocked, space.clearance = space.blocked.copy(), space.clearance.copy()
        room_m = space.footprint.reach_m + _ROOM_M
        reach = (space.footprint.reach_m + _AVOIDED_M) / space.grid.resolution_m
        for place in self._avoided:
            apart_m = min(math.dist(place, (end.x_m, end.y_m)) for end in ends)
            radius_m = min(_AVOIDED_M, apart_m - room_m)
            if radius_m > 0.0:
                disc = _disc(space, place, radius_m)
                close_disc(space.blocked, space.clearance, disc, reach)
        return space

    def _gaps(self) -> NDArray[np.float64]:
        """Return the discs between people who stand together, (k, 3) [m]: x, y, radius."""
        return self._world.standing.gaps(self._queue_m)

    def way_between_people_m(self, path: NDArray[np.float64]) -> float:
        """Return the length of a path (n, 3) of `world` between people who stand together [m]."""
        gaps = self._gaps()
        if not len(gaps):
            return 0.0
        places = dense(path, _STEP_M)[:, :2]
        ways_m = np.hypot(*np.diff(places, axis=0).T)
        away_m = np.hypot(*(places[1:, np.newaxis] - gaps[:, :2]).T)  # (gaps, places)
        return float(ways_m[(away_m <= gaps[:, 2:]).any(axis=0)].sum())

    def arc_to(self, pose: SE2, goal: Goal) -> Plan | None:
        """Return the free arc of a robot that steers to a goal ahead of it; None: there is none."""
        arc = arc_to(pose, goal, self.turning_radius_m) if self.steered else None
        return None if arc is None or self._world.touches(arc.poses) else arc

    def closed_way(self, pose: SE2, goal: Goal) -> ClosedWay | PlanFailure | None:
        """Return how far the way is free that leads there if nothing but the map were there.

        None: nothing closes it, or the robot has no map.
        """
        if not self._world.has_map:
            return None
        begin, there = (pose @ _TURNED, goal.opposite) if self.reverse else (pose, goal)
        given, live = self._world.given, self._world.map.space()
        aim = there.seen_from(begin)
        if failure := blocked_goal(given, aim):
            return failure
        answer = self._way(priced(given, live), begin, aim)
        if isinstance(answer, PlanFailure):
            return answer
        if self.reverse:
            answer = _turned_round(answer)
        return until_closed(answer, given, live, self._world.moving)

    def is_doubtful(self, plan: Plan, pose: SE2) -> bool:
        """Return whether a path leads far away through what was forgotten on this journey.

        Where the robot does not look now, what it has seen there may stand there still. Without
        that it would turn back on a long way round, again and again.
        """
        space = self._world.forgotten()
        if space is None:
            return False
        places = dense(plan.poses, space.grid.resolution_m)
        far = np.hypot(*(places[:, :2] - (pose.x_m, pose.y_m)).T) > _LOOKS_M
        return bool(space.collides(space.poses_to_cells(places[far])).any())


def _disc(space: PlanningMap, place: Point, radius_m: float) -> Disc:
    """Return a disc about a place of `world` [m] in the frame of a map."""
    middle = space.to_cells(SE2(*place))
    return Disc(middle.x_m, middle.y_m, radius_m / space.grid.resolution_m)


def _turned_round(plan: Plan) -> Plan:
    """Return a path to be driven in the other gear."""
    half_turn = np.array([0.0, 0.0, math.pi])
    return replace(plan, poses=plan.poses + half_turn, reverse=~plan.reverse)
