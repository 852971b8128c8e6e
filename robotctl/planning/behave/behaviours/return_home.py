"""The behaviours that drive back home: by plan, or along the breadcrumbs."""

from __future__ import annotations

import math

from robotctl.messages.mode import Mode
from robotctl.model.drives.drives import Drive
from robotctl.model.fence import Point
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.behaviour import (
    Anchor,
    Behaviour,
    BehaviourInput,
    BehaviourOutput,
    Status,
    done,
    failed,
)
from robotctl.planning.behave.behaviours.breadcrumbs import Breadcrumbs, Leg
from robotctl.planning.behave.behaviours.follow_path import FollowPath
from robotctl.planning.behave.behaviours.goto import Piloted
from robotctl.planning.behave.behaviours.kind import Kind, NavigatedRobot
from robotctl.planning.config import PursuitConfig
from robotctl.planning.path.global_planning.goal import Goal
from robotctl.planning.path.local.path import Path


class ReturnHome(Behaviour):
    """Follows the breadcrumbs home, leg by leg, removing them as it goes.

    Interrupted, it continues with the rest, including crumbs added meanwhile. Found elsewhere, it
    continues from the nearest of them. It ends within the crumbs' spacing of home.

    Parameters
    ----------
    crumbs
        The path from home; shortened as the robot returns.
    config, drive, speed_m_s
        As for `Pursuit`.
    """

    def __init__(
        self, crumbs: Breadcrumbs, config: PursuitConfig, drive: Drive, speed_m_s: float
    ) -> None:
        self._legs: list[Leg] = []
        self._path: Path | None = None
        self._follow: FollowPath | None = None
        self._crumbs = crumbs
        self._config = config
        self._drive = drive
        self._speed = speed_m_s
        self.reset()

    def anchor(self, pose: SE2) -> Anchor:
        """Return the nearest crumb, and forget the path beyond it."""
        crumb = self._crumbs.nearest(pose)
        self.pause()
        return Anchor(crumb.x_m, crumb.y_m)

    def reset(self) -> None:
        """Plan the path home from the present crumbs."""
        self._legs = self._crumbs.legs()
        self._begin_leg()

    def join(self) -> None:
        """Continue from the nearest crumb with any heading, which may take a turning circle."""
        self.reset()
        if self._follow is not None:
            self._follow.join()

    def pause(self) -> None:
        """Replan when continuing."""
        self._legs, self._path = [], None

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return the next velocity; done at home."""
        if self._path is None:
            self.reset()
        while self._path is not None and self._follow is not None:
            step = self._follow.step(situation, now_ns)
            leg = self._legs[0]
            # Crumbs behind the robot are removed, so that an interrupted return continues from
            # here.
            self._crumbs.truncate(leg.last - self._path.segment_at(self._follow.s_m) + 1)
            if step.status is not Status.DONE:
                return step
            self._crumbs.truncate(leg.last - len(leg.points) + 2)
            del self._legs[0]
            self._begin_leg()
        return done("home")

    def _begin_leg(self) -> None:
        """Prepare to follow the first of the legs left."""
        self._path, self._follow = None, None
        if self._legs:
            leg = self._legs[0]
            self._path = Path(leg.points)
            self._follow = FollowPath(
                self._path, self._config, self._drive, self._speed, reverse=leg.reverse
            )


class PlannedReturn(Behaviour):
    """Drives home by plan, and along the breadcrumbs where that fails.

    With rally points, it drives to the nearest of those that a way leads to, and home if none does.

    Parameters
    ----------
    robot
        With a pilot, and the path that it came by.
    """

    def __init__(self, robot: NavigatedRobot) -> None:
        self._robot = robot
        self._crumbs = robot.crumbs
        self._trail = _trail(robot)
        self.reset()

    def anchor(self, pose: SE2) -> Anchor:
        """Return where the robot is, as long as it plans from there; else the nearest crumb."""
        return self._trail.anchor(pose) if self._failure else self._plan.anchor(pose)

    def reset(self) -> None:
        """Plan again."""
        self._failure = ""
        self._rally: list[Point] | None = None
        """The rally points that are left to try, the nearest last; None: not begun."""
        self._rallies = False
        """Whether it drives to one of them now."""
        self._plan = self._to(self._home)
        self._trail.pause()

    def join(self) -> None:
        """Continue near the anchor."""
        (self._trail if self._failure else self._plan).join()

    def pause(self) -> None:
        """Replan after the pause; on the breadcrumbs, replan those."""
        self._plan.pause()
        self._trail.pause()

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return the next velocity; done at home, or at a rally point."""
        if not self._failure:
            # The way back to the way it came has to be known should the plan fail.
            self._crumbs.record(situation.pose)
            if self._rally is None:
                self._rally = self._sorted(situation.pose)
                self._next()
            step = self._plan.step(situation, now_ns)
            while step.status is Status.FAILED and self._rallies:
                self._next()
                step = self._plan.step(situation, now_ns)
            if step.status is not Status.FAILED:
                place = "at a rally point" if self._rallies else "home"
                return done(place) if step.status is Status.DONE else step
            if self._crumbs.has_gap:
                return failed(f"{step.text}; and it does not know all of the way it came")
            self._failure = step.text
            self._trail.reset()
        step = self._trail.step(situation, now_ns)
        if step.status is Status.DONE:
            return step
        return step._replace(text=f"back the way it came ({self._failure}): {step.text}")

    @property
    def _home(self) -> Point:
        home = self._crumbs.home
        return home.x_m, home.y_m

    def _sorted(self, pose: SE2) -> list[Point]:
        """Return the rally points, the nearest last."""
        here = pose.x_m, pose.y_m
        return sorted(self._robot.rally, key=lambda each: -math.dist(each, here))

    def _next(self) -> None:
        """Drive to the nearest rally point that was not tried, or home after the last."""
        self._rallies = bool(self._rally)
        self._plan = self._to(self._rally.pop() if self._rally else self._home)

    def _to(self, place: Point) -> Piloted:
        goal, speed_m_s = Goal(*place), self._robot.config.return_speed_m_s
        return Piloted(lambda pilot: pilot.journey(goal, speed_m_s), self._robot)


def _trail(robot: NavigatedRobot) -> ReturnHome:
    config = robot.config
    return ReturnHome(robot.crumbs, config.pursuit, robot.drive, config.return_speed_m_s)


def _make(_mode: Mode, robot: NavigatedRobot) -> Behaviour:
    return PlannedReturn(robot) if robot.plans_home else _trail(robot)


RETURN_HOME = Kind(_make)
