"""The behaviour that follows a wall."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from robotctl.control.wall_following import (
    WallFollowConfig,
    WallFollower,
    critically_damped,
)
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.behave.behaviours.behaviour import (
    Anchor,
    Behaviour,
    BehaviourInput,
    BehaviourOutput,
    done,
    failed,
)
from robotctl.planning.behave.behaviours.item import (
    NO_LENGTH_S,
    require_points,
    require_positive,
    time_for,
)
from robotctl.planning.behave.behaviours.kind import Abilities, Kind, NavigatedRobot
from robotctl.planning.config import WallConfig
from robotctl.planning.guard.sonars import sonar_towards
from robotctl.planning.path.local.path import Point

Side: TypeAlias = Literal["left", "right"]

_TURNED_MAX_RAD = math.radians(30.0)
"""Turned by more in another mode, the robot would follow a different wall."""


@dataclass(frozen=True, slots=True)
class Until:
    """When wall following is done: as soon as one of the conditions given is met.

    Parameters
    ----------
    length_m
        The robot has travelled this far [m], > 0.
    front_below_m
        The front sonar sees something nearer than this [m], > 0.
    position
        The robot has come abeam of this point of `world` [m], or past it.
    """

    length_m: float | None = None
    front_below_m: float | None = None
    position: Point | None = None

    def __post_init__(self) -> None:
        require_positive(self, "length_m", "front_below_m")
        if (self.length_m, self.front_below_m, self.position) == (None, None, None):
            raise ValueError("one of length_m, front_below_m and position is needed")
        if self.position is not None:
            require_points("position", (self.position,))


@dataclass(frozen=True, slots=True)
class FollowWallItem:
    """Drive along a wall at a constant distance.

    Parameters
    ----------
    kind
        Always "follow_wall".
    side
        Where the wall is: "left" or "right".
    distance_m
        Wanted distance of `base`, the middle of the robot, from the wall [m], > 0: what the sonar
        on that side reads, and how far aside it sits.
    until
        When it is done.
    speed_m_s
        Speed [m/s], > 0.
    name
        Name shown to people.
    time_out_s
        The item fails after this time [s], > 0. Default: from its length and speed, or 60 s.
    """

    kind: Literal["follow_wall"]
    side: Side
    distance_m: float
    until: Until
    speed_m_s: float = 0.3
    name: str = ""
    time_out_s: float | None = None

    def __post_init__(self) -> None:
        require_positive(self, "distance_m", "speed_m_s", "time_out_s")


class FollowWall(Behaviour):
    """Drives along a wall until one of the item's conditions is met.

    After an interruption it continues if the robot is still where it stopped, with the same
    heading.

    Parameters
    ----------
    item
        Side, distance, speed and conditions.
    config
        See there.
    mounts
        The sonars, in the order of the ranges.
    off_max_m
        Farther from where it stopped the robot does not continue [m].

    Raises
    ------
    ValueError
        If there is no sonar for the side or for the condition on the front.
    """

    def __init__(
        self,
        item: FollowWallItem,
        config: WallConfig,
        mounts: Sequence[SonarMount],
        off_max_m: float,
    ) -> None:
        self._item = item
        self._off_max_m = off_max_m
        self._config = config
        self._side = _required(mounts, item.side)
        self._front = _required(mounts, "front") if item.until.front_below_m is not None else None
        self._lateral = abs(mounts[self._side].y_m)
        gains = critically_damped(config.length_m)
        self._follower = WallFollower(
            WallFollowConfig(
                side=item.side,
                distance_m=item.distance_m,
                kp=gains.kp,
                kd=gains.kd,
                omega_max_rad_s=config.omega_max_rad_s,
                approach_max_rad=math.radians(config.approach_max_deg),
                range_max_m=item.distance_m + 2.0,
            )
        )
        self.reset()

    @property
    def s_m(self) -> float:
        """Distance along the wall so far [m]."""
        return self._travelled

    def anchor(self, pose: SE2) -> Anchor | None:  # noqa: ARG002 - as all behaviours
        """Return where along the wall it is, or was left; None before it began."""
        left = self._left if self._last is None else self._last[0]
        return None if left is None else Anchor(left.x_m, left.y_m, left.theta_rad)

    def resume(self, s_m: float) -> None:
        """Continue from the robot's present place, having driven `s_m` [m]."""
        self.reset()
        self._travelled = self._lost_since = s_m

    def reset(self) -> None:
        """Start over: nothing travelled, no wall known."""
        self._follower.reset()
        self._last: tuple[SE2, int] | None = None
        self._left: SE2 | None = None
        self._travelled = 0.0
        self._lost_since = 0.0
        self._near = 0

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return the next velocity; fails without a wall for too long a distance.

        It fails, too, where the robot is not any more where it was left.
        """
        pose, speed = situation.pose, self._item.speed_m_s
        if self._left is not None and (elsewhere := self._elsewhere(self._left, pose)):
            return failed(elsewhere)
        self._left = None
        dt = 0.0
        if self._last is not None:
            before, before_ns = self._last
            dt = (now_ns - before_ns) / 1e9
            self._travelled += math.hypot(pose.x_m - before.x_m, pose.y_m - before.y_m)
        self._last = (pose, now_ns)
        if self._met(situation):
            return done()
        reading = situation.ranges_m[self._side] + self._lateral
        twist = situation.twist
        omega = self._follower.step(reading, twist.v_m_s, dt, twist.omega_rad_s)
        if not self._follower.lost:
            self._lost_since = self._travelled
        elif self._travelled - self._lost_since > self._config.lost_max_m:
            return failed(f"no wall on the {self._item.side} for {self._config.lost_max_m:g} m")
        return BehaviourOutput(speed, omega, text=f"{self._travelled:.1f} m along the wall")

    def pause(self) -> None:
        """Forget the wall, which may change in another mode, but not its place."""
        if self._last is not None:
            self._left, self._last = self._last[0], None
        self._lost_since = self._travelled
        self._follower.reset()

    def _elsewhere(self, left: SE2, pose: SE2) -> str:
        """Return how the robot is not where it was left; empty if it is."""
        off_m = math.hypot(pose.x_m - left.x_m, pose.y_m - left.y_m)
        turned_rad = abs(wrap_angle(pose.theta_rad - left.theta_rad))
        if off_m <= self._off_max_m and turned_rad <= _TURNED_MAX_RAD:
            return ""
        return (
            f"not where it was left: {off_m:.2f} m away and turned by "
            f"{math.degrees(turned_rad):.0f} deg, {self._off_max_m:g} m and "
            f"{math.degrees(_TURNED_MAX_RAD):.0f} deg are allowed"
        )

    def _met(self, situation: BehaviourInput) -> bool:
        """Say whether a condition to end is met; the front sonar has to say so twice running."""
        until, pose = self._item.until, situation.pose
        if until.length_m is not None and self._travelled >= until.length_m:
            return True
        if until.front_below_m is not None and self._front is not None:
            if situation.new[self._front]:
                near = situation.ranges_m[self._front] < until.front_below_m
                self._near = self._near + 1 if near else 0
            if self._near >= 2:
                return True
        if until.position is None:
            return False
        dx, dy = until.position[0] - pose.x_m, until.position[1] - pose.y_m
        return dx * math.cos(pose.theta_rad) + dy * math.sin(pose.theta_rad) <= 0.0


def _required(mounts: Sequence[SonarMount], direction: str) -> int:
    """Return the index of the sonar in a direction."""
    index = sonar_towards(mounts, direction)
    if index is None:
        raise ValueError(f"no sonar looks to the {direction}")
    return index


def _make(item: FollowWallItem, robot: NavigatedRobot) -> FollowWall:
    config = robot.config
    return FollowWall(item, config.wall, robot.mounts, config.pursuit.off_path_max_m)


def _time_out_s(item: FollowWallItem) -> float:
    length_m = item.until.length_m
    known_s = NO_LENGTH_S if length_m is None else time_for(length_m, item.speed_m_s)
    return item.time_out_s or known_s


def _problems(item: FollowWallItem, robot: Abilities) -> Iterator[str]:
    guard = robot.guard
    needed = [item.side] + (["front"] if item.until.front_below_m is not None else [])
    for side in needed:
        if side not in robot.sides:
            yield f"this robot has no sonar that looks to the {side}"
    side_m = robot.body.left_m if item.side == "left" else robot.body.right_m
    if item.distance_m < side_m:
        yield (
            f"distance_m = {item.distance_m:g} is from the robot's middle to the wall, which its "
            f"side would touch; {side_m:g} at least ([body] outline, or "
            "navigation.guard.half_width_m) is allowed"
        )
    front_m = item.until.front_below_m
    if front_m is not None and front_m <= guard.margin_m:
        yield (
            f"until.front_below_m = {front_m:g} is never reached, since this robot stops "
            f"{guard.margin_m:g} m "
            "before an obstacle; above navigation.guard.margin_m is allowed"
        )


FOLLOW_WALL = Kind(_make, _time_out_s, _problems)
