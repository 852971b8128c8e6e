"""Mode GUIDED: velocities and targets of a ground station or of an off-board program."""

from __future__ import annotations

import math
from typing import Final, TypeAlias

from robotctl.messages.requests import (
    ExploreRequest,
    PlaceRequest,
    PositionRequest,
    VelocityRequest,
    on_earth,
)
from robotctl.model.fence import Point
from robotctl.model.geometry.angles import wrap_angle
from robotctl.planning.behave.behaviours.behaviour import BehaviourInput, BehaviourOutput, Status
from robotctl.planning.behave.behaviours.kind import NavigatedRobot
from robotctl.planning.behave.behaviours.registry import behaviour_for
from robotctl.planning.behave.behaviours.rejoin import Rejoining
from robotctl.planning.behave.modes.drive_mode import DriveMode
from robotctl.planning.behave.remote_velocity import guided_velocity
from robotctl.planning.path.global_planning.goal import Goal

TargetRequest: TypeAlias = PositionRequest | ExploreRequest | PlaceRequest
"""Requests that GUIDED drives to the end of."""

_SAME_M: Final = 1e-3
"""Positions that differ by less are one [m]."""
_SAME_RAD: Final = 1e-3
"""Headings that differ by less are one [rad]."""
_STREAM_NS: Final = 1_500_000_000
"""Longest gap between two messages of a stream of positions [ns]."""


class Guided(DriveMode):
    """Drives to the last target, or at the last velocity until that expires.

    Parameters
    ----------
    robot
        The robot that drives.

    Attributes
    ----------
    goals
        Positions, places and explorations taken since the start.
    goal_reached
        How the last of them ended; None: it is under way, or was given up for something else.
    """

    def __init__(self, robot: NavigatedRobot) -> None:
        self._robot = robot
        self.goals = 0
        self.goal_reached: bool | None = None
        self._requested_ns = 0
        """Time of the last request for a position [ns]."""
        self._speed_m_s = 0.0
        """Largest speed to the last target [m/s]."""
        self._goal: Point | None = None
        """Goal of the last target, if that is a position."""
        self.begin()

    @property
    def is_under_way(self) -> bool:
        """Whether it drives to a target."""
        return self._behaviour is not None

    @property
    def goal(self) -> Point | None:
        """Position that it drives to now [m]; None: it drives to none."""
        return None if self._behaviour is None else self._goal

    @property
    def expires_ns(self) -> int | None:
        """When the velocity is void [ns]; None: there is none."""
        return None if self._velocity is None else self._velocity.expires_ns

    def begin(self) -> None:
        """Wait for a velocity or a target."""
        self._velocity: VelocityRequest | None = None
        self._target: TargetRequest | None = None
        """Present or last target."""
        self._behaviour: Rejoining | None = None
        self._arrived: Rejoining | None = None
        """Behaviour that has ended at the last position; a stream of positions goes on with it."""
        self._ended = ""

    def pause(self) -> None:
        """Stop on the way to the target, and its time."""
        if self._behaviour is not None:
            self._behaviour.pause()

    def relocate(self) -> None:
        """Continue to the target from where the robot is found."""
        if self._behaviour is not None:
            self._behaviour.relocate()

    def lose_place(self) -> None:
        """Drop a velocity along a direction of the world: the robot's heading there is unknown."""
        if self._velocity is not None and self._velocity.needs_place:
            self._velocity = None

    def take_velocity(self, request: VelocityRequest) -> None:
        """Drive at a velocity in place of to a target."""
        self._velocity = request
        self._behaviour = self._target = self._arrived = None

    def take_target(self, request: TargetRequest, now_ns: int) -> None:
        """Drive to a target.

        Off-board programs send the same position many times a second, or one that moves: the robot
        is on its way then and stays so. What it has given up it tries again once the stream has
        ended.
        """
        self.goals += 1
        self._velocity = None
        if isinstance(request, PositionRequest):
            if not on_earth(request.x_m, request.y_m):
                return
            streams = now_ns - self._requested_ns <= _STREAM_NS
            self._requested_ns = now_ns
            if self._repeats(request, streams=streams):
                return
            if self._behaviour is None and streams:
                self._behaviour = self._arrived
        self._set_off(request)

    def _set_off(self, request: TargetRequest) -> None:
        """Drive to a target that is another one, as part of the present drive where it can be."""
        self.goal_reached, self._ended = None, ""
        self._goal = (request.x_m, request.y_m) if isinstance(request, PositionRequest) else None
        self._speed_m_s = self._robot.config.guided_speed_m_s
        before, self._target = self._target, request
        if (
            self._behaviour is not None
            and isinstance(request, PositionRequest)
            and isinstance(before, PositionRequest)
        ):
            self._behaviour.redirect(Goal(*request), self._speed_m_s)
        else:
            self._behaviour = behaviour_for(request, self._robot)

    def _repeats(self, request: PositionRequest, *, streams: bool) -> bool:
        """Return whether a position only repeats the present one, or one that was given up."""
        if not isinstance(self._target, PositionRequest) or not _are_same(request, self._target):
            return False
        if self._behaviour is not None:
            return self._speed_m_s == self._robot.config.guided_speed_m_s
        return streams and self.goal_reached is False

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return the velocity to the target, or the one that was asked for."""
        if self._behaviour is not None:
            step = self._behaviour.step(situation, now_ns)
            if step.status is Status.RUNNING:
                return step
            self._arrived, self._behaviour = self._behaviour, None
            self._ended = step.text or "arrived"
            self.goal_reached = step.status is Status.DONE
        if self._velocity is None:
            return BehaviourOutput(0.0, 0.0, text=self._ended)
        heading_rad, robot = situation.pose.theta_rad, self._robot
        return guided_velocity(self._velocity, heading_rad, robot.drive, robot.guard, now_ns)


def _are_same(one: PositionRequest, other: PositionRequest) -> bool:
    """Return whether two positions differ only by rounding."""
    if math.dist(one[:2], other[:2]) > _SAME_M:
        return False
    if one.heading_rad is None or other.heading_rad is None:
        return one.heading_rad is other.heading_rad
    return abs(wrap_angle(one.heading_rad - other.heading_rad)) <= _SAME_RAD
