"""The behaviour that drives to a place by plan, round what stands in the way."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

from robotctl.errors import InvalidValue
from robotctl.messages.requests import PositionRequest
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.behaviour import (
    Anchor,
    Behaviour,
    BehaviourInput,
    BehaviourOutput,
    failed,
)
from robotctl.planning.behave.behaviours.item import require_bounded, require_positive
from robotctl.planning.behave.behaviours.kind import Kind, NavigatedRobot, Pilot
from robotctl.planning.behave.behaviours.straight_to import straight_to
from robotctl.planning.path.global_planning.goal import Goal

_WIDEST_M: Final = 10.0
"""Largest tolerance [m]."""

NO_PILOT = "this robot has neither a map nor a lidar to plan by"


@dataclass(frozen=True, slots=True)
class GotoItem:
    """Drive to a place of `world` by plan, round what stands in the way.

    Parameters
    ----------
    kind
        Always "goto".
    x_m, y_m
        The place [m].
    heading_deg
        Heading at the end [deg]; None: any.
    tolerance_m
        Distance from the place within which it is reached, and to which the robot drives where
        something stands on it [m], above 0 to 10; None: `navigation.follow.position_tolerance_m`,
        and nowhere else.
    speed_m_s
        Largest speed [m/s], > 0; None: that of positions from a ground station.
    name
        Name shown to people.
    time_out_s
        The item fails after this time [s], > 0; None: when its recoveries are used up.
    """

    kind: Literal["goto"]
    x_m: float
    y_m: float
    heading_deg: float | None = None
    tolerance_m: float | None = None
    speed_m_s: float | None = None
    name: str = ""
    time_out_s: float | None = None

    def __post_init__(self) -> None:
        require_bounded(self, "x_m", "y_m")
        if self.heading_deg is not None:
            require_bounded(self, "heading_deg")
        require_positive(self, "speed_m_s", "time_out_s")
        if self.tolerance_m is not None and not 0.0 < self.tolerance_m <= _WIDEST_M:
            rule = f"must be above 0 and at most {_WIDEST_M:g}, not {self.tolerance_m}"
            raise InvalidValue("tolerance_m", rule, self.tolerance_m)


class Piloted(Behaviour):
    """A behaviour of the robot's pilot, which is there only once the robot has started.

    Parameters
    ----------
    make
        Returns the behaviour of a pilot.
    robot
        With its pilot.
    """

    def __init__(self, make: Callable[[Pilot], Behaviour], robot: NavigatedRobot) -> None:
        self._make = make
        self._robot = robot
        self._behaviour: Behaviour | None = None

    def anchor(self, pose: SE2) -> Anchor:
        """Return where the robot is: it plans from there."""
        return Anchor(pose.x_m, pose.y_m)

    def reset(self) -> None:
        """Start over."""
        self._behaviour = None

    def pause(self) -> None:
        """Replan after the pause."""
        if self._behaviour is not None:
            self._behaviour.pause()

    def redirect(self, goal: Goal, speed_m_s: float) -> None:
        """Drive to another place from now on."""
        if self._behaviour is None:
            self._make = lambda pilot: pilot.journey(goal, speed_m_s)
        else:
            self._behaviour.redirect(goal, speed_m_s)

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return the next velocity."""
        if self._robot.pilot is None:
            return failed(NO_PILOT)
        if self._behaviour is None:
            self._behaviour = self._make(self._robot.pilot)
        return self._behaviour.step(situation, now_ns)


def _drive(goal: Goal, speed_m_s: float, robot: NavigatedRobot) -> Piloted:
    return Piloted(lambda pilot: pilot.journey(goal, speed_m_s), robot)


def _make(item: GotoItem, robot: NavigatedRobot) -> Piloted:
    heading_rad = None if item.heading_deg is None else math.radians(item.heading_deg)
    speed_m_s = item.speed_m_s or robot.config.guided_speed_m_s
    return _drive(Goal(item.x_m, item.y_m, heading_rad, item.tolerance_m), speed_m_s, robot)


def _time_out_s(item: GotoItem) -> float | None:
    return item.time_out_s


def _make_guided(wanted: PositionRequest, robot: NavigatedRobot) -> Behaviour:
    speed_m_s = robot.config.guided_speed_m_s
    if robot.pilot is None:
        return straight_to(wanted.x_m, wanted.y_m, speed_m_s, robot)
    return _drive(Goal(*wanted), speed_m_s, robot)


GOTO = Kind(_make, _time_out_s, piloted=True)
GUIDED_POSITION = Kind(_make_guided)
