"""The present path to a goal, and when another one is planned."""

from __future__ import annotations

import math
from typing import Final

from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.journey.tools import JourneyTools
from robotctl.planning.path.global_planning.goal import Goal
from robotctl.planning.path.global_planning.plan import Plan, PlanFailure
from robotctl.planning.path.global_planning.route import Route

_REDIRECTED_NS: Final = 500_000_000
"""Shortest time between two plans while the goal moves [ns]."""


class Replanner:
    """Plans to a goal, which may move, and keeps the path while it is good.

    Parameters
    ----------
    tools
        World, paths and controller.
    goal
        Where to.

    Attributes
    ----------
    goal
        Where to now.
    route
        The present path; None: there is none.
    plans
        Paths taken, the first included.
    planned_ns
        Time of the last plan [ns]; 0: there was none since a pause.
    is_redirected
        Whether the goal has moved away from the end of the path.
    chases
        Whether it has moved since the last look for a path.
    """

    def __init__(self, tools: JourneyTools, goal: Goal) -> None:
        self._tools = tools
        self._replan_ns = round(1e9 * tools.journey.replan_s)
        self.goal = goal
        self.plans = 0
        self.reset()

    def reset(self) -> None:
        """Plan to the goal again."""
        self._aim = self.goal
        """Goal that the path was planned to."""
        self.pause()

    def pause(self) -> None:
        """Plan again in the next step."""
        self.route: Route | None = None
        self.is_redirected = False
        self.chases = False
        self.planned_ns = 0
        self._planned_reverse = self._tools.paths.reverse

    def redirect(self, goal: Goal) -> None:
        """Lead to another goal; along the present path until the next is planned."""
        self.goal = goal
        self.is_redirected = not self._is_near(self._aim, 0.5)
        self.chases = self.is_redirected or self.route is None

    def is_due(self, pose: SE2, now_ns: int) -> bool:
        """Return whether it is time to plan: there is no path, it is far away, or a while ago."""
        route = self.route
        turned_round = self._planned_reverse is not self._tools.paths.reverse
        if route is None or turned_round or route.advance(pose) > self._tools.journey.off_path_m:
            self.route = None
            return True
        every_ns = _REDIRECTED_NS if self.is_redirected else self._replan_ns
        return now_ns - self.planned_ns >= every_ns

    def plan(self, pose: SE2, now_ns: int) -> Route | PlanFailure:
        """Plan from here; keep the present path where it is free and hardly worse."""
        self.planned_ns, self._planned_reverse = now_ns, self._tools.paths.reverse
        chases, self.chases = self.chases, False
        if chases and (route := self._chase(pose)):
            return route
        leads_there = not self._tools.paths.is_far(pose, self.goal)
        old, answer = self.route, self._tools.paths.plan(pose, self.goal)
        self._tools.pace.lap("plan")
        if self.is_redirected or (old is not None and self._tools.world.touches(old.rest)):
            old = None
        if isinstance(answer, PlanFailure):
            return old or answer
        if old is not None and old.leads_there and not self._leads_round_people(answer, old):
            is_better = answer.length_m <= self._tools.journey.better * old.left_m
            if not is_better or self._tools.paths.is_doubtful(answer, pose):
                return old
        self._take_aim()
        leaves = self._tools.world.map.shut.closed_at(pose)
        until = f" out of {leaves}" if leaves else ""
        return Route(answer, leads_there=leads_there and not leaves, until=until)

    def _leads_round_people(self, answer: Plan, old: Route) -> bool:
        """Return whether a path leads round people who stand together, and the old one does not."""
        between_m = self._tools.paths.way_between_people_m
        return between_m(old.rest) > between_m(answer.poses)

    def _chase(self, pose: SE2) -> Route | None:
        """Return the arc of a robot that steers to a goal that moves; None: it is to plan.

        Where the goal is too near beside it, it stays on its path: the goal will move on.
        """
        arc = self._tools.paths.arc_to(pose, self.goal)
        if arc is not None:
            self._take_aim()
            return Route(arc)
        is_near = (
            math.dist((pose.x_m, pose.y_m), self.goal[:2]) < self._tools.paths.turning_radius_m
        )
        old = self.route
        if old is None or not is_near or self._tools.world.touches(old.rest):
            return None
        return old

    def _take_aim(self) -> None:
        """Note that there is a new path, to the goal."""
        self.plans += 1
        self._aim, self.is_redirected = self.goal, False

    def stands_there(self, pose: SE2) -> bool:
        """Return whether a pose is at the goal, its heading included."""
        return self._is_near(Goal(pose.x_m, pose.y_m, pose.theta_rad), 1.0)

    def is_there(self, pose: SE2) -> bool:
        """Return whether a pose is at a goal where no controller has to lead to the very place."""
        any_pose = self.goal.heading_rad is None or self.goal.tolerance_m is not None
        return any_pose and self.stands_there(pose)

    def _is_near(self, place: Goal, share: float) -> bool:
        """Return whether a place is within a share of the tolerances of the goal."""
        config, wanted_rad = self._tools.config, self.goal.heading_rad
        tolerance_m = self.goal.tolerance_m or config.position_tolerance_m
        if math.dist(place[:2], self.goal[:2]) > share * tolerance_m:
            return False
        if wanted_rad is None or place.heading_rad is None:
            return wanted_rad is None
        off_rad = wrap_angle(place.heading_rad - wanted_rad)
        return abs(off_rad) <= share * config.heading_tolerance_rad
