"""The return of a robot that was found elsewhere to where its behaviour was interrupted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.behaviour import (
    Anchor,
    Behaviour,
    BehaviourInput,
    BehaviourOutput,
    Status,
    done,
)
from robotctl.planning.behave.behaviours.guarded import Guarded
from robotctl.planning.behave.behaviours.kind import NavigatedRobot
from robotctl.planning.behave.behaviours.straight_to import StraightTo
from robotctl.planning.behave.behaviours.turn_to import TurnTo
from robotctl.planning.path.global_planning.goal import Goal

_NEAR_M: Final = 0.2
"""Distance within which a robot that goes straight is back on the path of its behaviour [m]."""


class Rejoin(Behaviour):
    """Drives back, part by part.

    Parameters
    ----------
    parts
        What to do, one after the other.
    """

    def __init__(self, parts: Sequence[Behaviour]) -> None:
        self._all = parts
        self.reset()

    def reset(self) -> None:
        """Begin with the first part."""
        self._left = list(self._all)
        self.pause()

    def pause(self) -> None:
        """Continue with the part that it was at."""
        for each in self._left:
            each.pause()

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return the next velocity; done at the end."""
        while self._left:
            step = self._left[0].step(situation, now_ns)
            if step.status is not Status.DONE:
                return step._replace(text=f"back to where it was interrupted, {step.text}")
            del self._left[0]
        return done()


class Rejoining(Behaviour):
    """A behaviour that continues from its own place when the robot is found elsewhere.

    The robot was carried away, or its localiser had been wrong: the epoch of its pose in `world`
    changes, or it has had to look around. It drives back by plan if it can, otherwise on a straight
    line; then the behaviour continues.

    Parameters
    ----------
    behaviour
        The behaviour.
    robot
        That does it.
    """

    def __init__(self, behaviour: Guarded, robot: NavigatedRobot) -> None:
        self._behaviour = behaviour
        self._robot = robot
        self._pose: SE2 | None = None
        """Pose of the last step."""
        self._epoch: tuple[int, int] | None = None
        """Epoch of the last step; None after an interruption."""
        self._relocated = False
        self._rejoin: Guarded | None = None

    @property
    def s_m(self) -> float:
        """Distance along the path or wall [m]; 0 for a behaviour without one."""
        return self._behaviour.s_m

    def relocate(self) -> None:
        """Let a robot that lost and found its pose return to where this was interrupted."""
        self._relocated = True

    def resume(self, s_m: float) -> None:
        """Stand where an earlier run was interrupted; the robot may have moved since."""
        self._behaviour.resume(s_m)
        # At the start of an item there is no earlier place to return to.
        self._relocated = s_m > 0.0

    def reset(self) -> None:
        """Start over."""
        self._relocated, self._rejoin, self._epoch = False, None, None
        self._behaviour.reset()

    def pause(self) -> None:
        """Another mode steers for a while."""
        self._epoch = None
        self._behaviour.pause()
        if self._rejoin is not None:
            self._rejoin, self._relocated = None, True

    def retry(self) -> None:
        """Continue after a failure from the robot's present place, with the full time again."""
        self._behaviour.retry()

    def redirect(self, goal: Goal, speed_m_s: float) -> None:
        """Drive to another place from now on; the way back there is another one, too."""
        self._behaviour.redirect(goal, speed_m_s)
        if self._rejoin is not None:
            self._rejoin, self._relocated = None, True

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return the next velocity: on the path back, if any, otherwise of the behaviour."""
        if self._epoch is not None and situation.epoch != self._epoch:
            self.pause()
            self._relocated = True
        if self._relocated:
            self._relocated, self._rejoin = False, self._way_back(situation.pose)
        self._pose, self._epoch = situation.pose, situation.epoch
        if self._rejoin is not None:
            step = self._rejoin.step(situation, now_ns)
            if step.status is Status.RUNNING:
                return step
            self._rejoin = None
            if step.status is Status.FAILED:
                self._relocated = True
                return step
            self._behaviour.join()
        return self._behaviour.step(situation, now_ns)

    def _way_back(self, pose: SE2) -> Guarded | None:
        """Return the path back to the point of interruption; None if the robot is near it."""
        anchor, robot = self._behaviour.anchor(pose), self._robot
        if anchor is None and self._pose is not None:
            anchor = Anchor(self._pose.x_m, self._pose.y_m)
        if anchor is None:
            return None
        off_m = math.hypot(anchor.x_m - pose.x_m, anchor.y_m - pose.y_m)
        turned = anchor.heading_rad is not None and not robot.drive.steered
        # Near enough for the behaviour itself to continue.
        if off_m <= robot.config.pursuit.off_path_max_m and not turned:
            return None
        return Guarded(Rejoin(self._parts(anchor)), robot.guard, robot.config.guard)

    def _parts(self, anchor: Anchor) -> list[Behaviour]:
        """Return what leads back: by plan, or straight; one that cannot turn ends with any heading.

        It only has to get back to the path of its behaviour, not exactly to a point of it.
        """
        robot, place = self._robot, (anchor.x_m, anchor.y_m)
        config, speed_m_s = robot.config.pursuit, robot.config.guided_speed_m_s
        heading_rad = None if robot.drive.steered else anchor.heading_rad
        if robot.pilot is not None and robot.pilot.knows_ways:
            return [robot.pilot.journey(Goal(*place, heading_rad), speed_m_s)]
        near = replace(config, goal_tolerance_m=max(_NEAR_M, config.goal_tolerance_m))
        straight = StraightTo(*place, near, robot.drive, speed_m_s, robot.guard)
        return [straight] if heading_rad is None else [straight, TurnTo(heading_rad, config)]
