"""The behaviour that drives straight to a point."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from robotctl.model.drives.drives import Drive
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.behaviour import (
    Anchor,
    Behaviour,
    BehaviourInput,
    BehaviourOutput,
    done,
    failed,
)
from robotctl.planning.behave.behaviours.item import NO_LENGTH_S, require_bounded, require_positive
from robotctl.planning.behave.behaviours.kind import Kind, NavigatedRobot
from robotctl.planning.behave.behaviours.rearwards import Rearwards
from robotctl.planning.config import PursuitConfig
from robotctl.planning.guard.obstacle_guard import ObstacleGuard
from robotctl.planning.path.global_planning.goal import Goal
from robotctl.planning.path.local.pursuit import (
    bend_speed,
    heading_error_rad,
    in_base,
    miss_m,
    reachable_curvature,
    turn_rate,
)

_REACH_AGAIN = 1.15
"""Backing up for an unreachable point continues until it is reachable with this margin."""


@dataclass(frozen=True, slots=True)
class StraightToItem:
    """Drive straight to a point of `world`, with any final heading.

    Parameters
    ----------
    kind
        Always "straight_to".
    x_m, y_m
        The point [m].
    speed_m_s
        Largest speed [m/s], > 0.
    name
        Name shown to people.
    time_out_s
        The item fails after this time [s], > 0.
    """

    kind: Literal["straight_to"]
    x_m: float
    y_m: float
    speed_m_s: float = 0.4
    name: str = ""
    time_out_s: float | None = 60.0

    def __post_init__(self) -> None:
        require_bounded(self, "x_m", "y_m")
        require_positive(self, "speed_m_s", "time_out_s")


class StraightTo(Behaviour):
    """Drives straight to a point: a differential drive turns to face it first.

    A drive-and-steer robot drives an arc. A point inside of its smallest turning circles is out
    of reach of any single arc: it backs up straight until the point is within reach. Nobody told
    it to, so it fails instead where no sonar looks back.

    Parameters
    ----------
    x_m, y_m
        The point in `world` [m].
    config, drive, speed_m_s
        As for `Pursuit`.
    guard
        Knows whether a sonar looks back.
    """

    def __init__(
        self,
        x_m: float,
        y_m: float,
        config: PursuitConfig,
        drive: Drive,
        speed_m_s: float,
        guard: ObstacleGuard,
    ) -> None:
        self._goal = (x_m, y_m)
        self._config = config
        self._radius = drive.min_turning_radius_m
        self._curvature_max = 1.0 / self._radius if self._radius > 0.0 else math.inf
        self._steered = drive.steered
        self._sees_back = guard.looks(-1.0)
        self._speed = speed_m_s
        self.reset()

    def anchor(self, pose: SE2) -> Anchor:  # noqa: ARG002 - as all behaviours
        """Return the goal."""
        return Anchor(*self._goal)

    def reset(self) -> None:
        """Start over."""
        self._turning = False
        self._backing = False

    def pause(self) -> None:
        """Replan from the robot's present place."""
        self.reset()

    def redirect(self, goal: Goal, speed_m_s: float) -> None:
        """Drive to another point from now on; its heading does not matter."""
        self._goal, self._speed = (goal.x_m, goal.y_m), speed_m_s

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:  # noqa: ARG002 - as all behaviours
        """Return the next velocity; done within the goal tolerance of the point."""
        config, pose = self._config, situation.pose
        x, y = self._goal
        distance = math.hypot(x - pose.x_m, y - pose.y_m)
        if distance <= config.goal_tolerance_m:
            return done()
        text = f"{distance:.1f} m to go"
        bearing = heading_error_rad(pose, x, y)
        v = min(self._speed, math.sqrt(2.0 * config.acceleration_m_s2 * distance))
        if self._steered and self._must_back(pose):
            if not self._sees_back:
                return failed(f"{text}, too close beside: backing up needs a rear sonar")
            return BehaviourOutput(-0.5 * self._speed, 0.0, text=f"{text}, backing up")
        if not self._steered and self._must_turn(bearing):
            return BehaviourOutput(0.0, turn_rate(bearing, config), text=f"{text}, turning")
        curvature = reachable_curvature(*in_base(pose, x, y), self._curvature_max)
        v = max(min(v, bend_speed(abs(curvature), config)), min(config.creep_m_s, self._speed))
        return BehaviourOutput(v, curvature * v, text=text)

    def _must_back(self, pose: SE2) -> bool:
        """Say whether to back up; a point that full lock passes within tolerance is in reach."""
        x, y = self._goal
        if self._backing:
            miss = miss_m(pose, x, y, _REACH_AGAIN * self._radius)
            self._backing = miss > 0.0
        else:
            miss = miss_m(pose, x, y, self._radius)
            self._backing = miss > 0.8 * self._config.goal_tolerance_m
        return self._backing

    def _must_turn(self, bearing_rad: float) -> bool:
        """Say whether to turn on the spot; once begun, until the point is nearly ahead."""
        limit = self._config.turned_deg if self._turning else self._config.turn_on_spot_deg
        self._turning = abs(bearing_rad) > math.radians(limit)
        return self._turning


def straight_to(x_m: float, y_m: float, speed_m_s: float, robot: NavigatedRobot) -> Behaviour:
    """Return the behaviour that drives straight to a point of `world` [m], ahead or in reverse."""
    ahead = StraightTo(x_m, y_m, robot.config.pursuit, robot.drive, speed_m_s, robot.guard)
    return Rearwards(ahead, robot)


def _make(item: StraightToItem, robot: NavigatedRobot) -> Behaviour:
    return straight_to(item.x_m, item.y_m, item.speed_m_s, robot)


def _time_out_s(item: StraightToItem) -> float:
    return item.time_out_s or NO_LENGTH_S


STRAIGHT_TO = Kind(_make, _time_out_s)
