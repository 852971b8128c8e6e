"""The behaviour that drives to what is unknown until the map is complete."""

from __future__ import annotations

import math

from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.behaviour import (
    Anchor,
    Behaviour,
    BehaviourInput,
    BehaviourOutput,
    Status,
    done,
)
from robotctl.planning.behave.journey.journey import DriveTo, Journey
from robotctl.planning.behave.journey.tools import JourneyTools
from robotctl.planning.path.global_planning.frontiers import Frontier, frontiers, known_area_m2
from robotctl.planning.path.global_planning.goal import Goal
from robotctl.planning.path.global_planning.plan import Plan, Point


class Exploration(Behaviour):
    """Drives to the frontier with the shortest path until there is none (Yamauchi 1997).

    A frontier that stays when the robot has been there, that it cannot reach, or that takes several
    times as long as it should, is left out from then on: where a gap is as wide as the robot, paths
    through it come and go.

    Parameters
    ----------
    tools, speed_m_s
        As for `Journey`.
    drive_to
        Makes the journey to a frontier.
    """

    def __init__(self, tools: JourneyTools, drive_to: DriveTo, speed_m_s: float) -> None:
        self._tools = tools
        self._config = tools.journey.exploration
        self._drive_to = drive_to
        self._speed_m_s = speed_m_s
        self.reset()

    def anchor(self, pose: SE2) -> Anchor:
        """Return where the robot is: it chooses from there."""
        return Anchor(pose.x_m, pose.y_m)

    def reset(self) -> None:
        """Start over."""
        self._left_out: list[Point] = []
        self.pause()

    def pause(self) -> None:
        """Choose again after the pause."""
        self._target: Frontier | None = None
        self._journey: Journey | None = None
        self._looked_ns = 0
        self._end_ns = 0
        """When the present frontier is given up."""

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return the next velocity; done when the map is complete."""
        if blindness := self._tools.world.blindness:
            return BehaviourOutput(0.0, 0.0, text=f"waiting: {blindness}")
        if self._journey is None or now_ns - self._looked_ns >= round(1e9 * self._config.look_s):
            self._look(situation.pose, now_ns)
        if self._journey is None or self._target is None:
            area_m2 = known_area_m2(self._tools.world.map.space())
            return done(f"the map is complete: {area_m2:.1f} m2 of free floor")
        was_in_trouble = self._journey.is_in_trouble
        step = self._journey.step(situation, now_ns)
        if self._journey.is_in_trouble and not was_in_trouble:
            self._look(situation.pose, now_ns)
        if step.status is not Status.RUNNING:
            self._left_out.append(self._target.middle)
            self._journey = None
        at = self._target.middle
        text = f"exploring at x {at[0]:.1f} m, y {at[1]:.1f} m: {step.text}"
        return BehaviourOutput(step.v_m_s, step.omega_rad_s, text=text, vy_m_s=step.vy_m_s)

    def _look(self, pose: SE2, now_ns: int) -> None:
        """Choose a frontier, unless the present one is still there, and the way to it."""
        self._looked_ns, same_m = now_ns, self._config.same_m
        space, margin_m = self._tools.world.map.space(), self._tools.config.margin_m
        there = [
            each
            for each in frontiers(space, (pose.x_m, pose.y_m), margin_m)
            if not any(math.dist(each.middle, other) < same_m for other in self._left_out)
        ]
        old, journey = self._target, self._journey
        others = [
            each for each in there if old is None or math.dist(old.middle, each.middle) >= same_m
        ]
        if old is not None and journey is not None and len(others) < len(there):
            is_late = now_ns > self._end_ns
            target, path_m = None, math.inf
            if journey.is_in_trouble or is_late:
                target, path_m = self._nearest(pose, others)
            if target is None and not is_late:
                return
            self._left_out.append(old.middle)
        else:
            target, path_m = self._nearest(pose, there)
            if target is None and there:
                here = pose.x_m, pose.y_m
                target = min(there, key=lambda each: math.dist(here, each.place))
                path_m = math.dist(here, target.place)
        self._target, self._journey = target, None
        if target is not None:
            self._journey = self._drive_to(Goal(*target.place), self._speed_m_s)
            config = self._config
            self._end_ns = now_ns + round(1e9 * config.patient_s)
            self._end_ns += round(1e9 * config.slower * path_m / self._speed_m_s)

    def _nearest(self, pose: SE2, found: list[Frontier]) -> tuple[Frontier | None, float]:
        """Return the one with the shortest path of the nearest frontiers, and that path's length.

        None: none of them has a path.
        """
        here = pose.x_m, pose.y_m
        best, best_m = None, math.inf
        compared = self._config.compared
        for each in sorted(found, key=lambda each: math.dist(here, each.place))[:compared]:
            if math.dist(here, each.place) >= best_m:
                break
            plan = self._tools.paths.plan(pose, Goal(*each.place))
            if isinstance(plan, Plan) and plan.length_m < best_m:
                best, best_m = each, plan.length_m
        return best, best_m
