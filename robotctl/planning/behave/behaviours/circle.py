"""The behaviour that drives round a point: the steering law at a safe radius."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal

from robotctl.control.steering_law import Side, SteeringLawConfig, orbit_config, steer_round
from robotctl.model.drives.drives import Drive
from robotctl.model.geometry.angles import wrap_angle
from robotctl.planning.behave.behaviours.behaviour import (
    Behaviour,
    BehaviourInput,
    BehaviourOutput,
    done,
)
from robotctl.planning.behave.behaviours.item import require_bounded, require_positive, time_for
from robotctl.planning.behave.behaviours.kind import Abilities, Kind, NavigatedRobot
from robotctl.planning.behave.behaviours.rearwards import Rearwards
from robotctl.planning.config import PursuitConfig
from robotctl.planning.path.local.path import Point
from robotctl.planning.path.local.pursuit import bend_speed, curvature_max, heading_error_rad

_WHEELBASE_M: Final = 0.3
"""Wheelbase for the law [m]. Only the curvature counts, so any will do, also for a robot that has
none; the gain is meant for this one."""
_GAIN: Final = 2.0
"""An error decays over wheelbase / gain = 0.15 m: about the way in which the steering follows."""
_STEERING_MAX_RAD: Final = 1.0
"""Bound for a robot that turns on the spot [rad]: a curvature of 5 1/m."""
_ROOM: Final = 1.1
"""Radius over the minimum turning radius; leaves room for corrections."""
_CORNERS: Final = 36
"""Points of the outline, which are 0.4 % of the radius off the circle in between."""
_ON_CIRCLE: Final = 1.5
"""Distance from the centre, as a share of the radius, up to which the robot is on the circle."""


@dataclass(frozen=True, slots=True)
class CircleItem:
    """Drive round a point of `world`, from wherever the robot is.

    Parameters
    ----------
    kind
        Always "circle".
    x_m, y_m
        The centre [m].
    radius_m
        Distance of `base` from it [m], > 0.
    turns
        Number of turns, > 0.
    side
        Side of the robot on which the centre stays: "left" drives anticlockwise.
    speed_m_s
        Largest speed [m/s], > 0.
    name
        Name shown to people.
    time_out_s
        The item fails after this time [s], > 0. Default: from its length and speed.
    """

    kind: Literal["circle"]
    x_m: float
    y_m: float
    radius_m: float
    turns: float = 1.0
    side: Side = "left"
    speed_m_s: float = 0.3
    name: str = ""
    time_out_s: float | None = None

    def __post_init__(self) -> None:
        require_bounded(self, "x_m", "y_m")
        require_positive(self, "radius_m", "turns", "speed_m_s", "time_out_s")

    @property
    def length_m(self) -> float:
        """Length of all turns [m]."""
        return math.tau * self.radius_m * self.turns

    def outline(self) -> tuple[Point, ...]:
        """Return points on a whole turn, the first one again at the end [m]."""
        angles = [math.tau * k / _CORNERS for k in range(_CORNERS + 1)]
        r, x, y = self.radius_m, self.x_m, self.y_m
        return tuple((x + r * math.cos(each), y + r * math.sin(each)) for each in angles)


class Circle(Behaviour):
    """Drives along the tangent to the circle and then along it, until all turns are done.

    Parameters
    ----------
    item
        The circle.
    config, drive
        As for `Pursuit`.
    """

    def __init__(self, item: CircleItem, config: PursuitConfig, drive: Drive) -> None:
        self._item, self._config = item, config
        self._law = _law(item.radius_m, drive)
        self._sign = 1.0 if item.side == "left" else -1.0
        self.reset()

    @property
    def s_m(self) -> float:
        """Distance along the circle so far [m]."""
        return self._turned_rad * self._item.radius_m

    def reset(self) -> None:
        """Start over."""
        self.resume(0.0)

    def resume(self, s_m: float) -> None:
        """Continue at a distance along the circle [m]."""
        self._turned_rad = s_m / self._item.radius_m
        self.pause()

    def pause(self) -> None:
        """Keep the turns so far; motion in another mode does not count."""
        self._around_rad: float | None = None

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:  # noqa: ARG002 - as all behaviours
        """Return the next velocity; done after the last turn."""
        item, config, pose = self._item, self._config, situation.pose
        dx_m, dy_m = pose.x_m - item.x_m, pose.y_m - item.y_m
        distance_m = math.hypot(dx_m, dy_m)
        self._count(math.atan2(dy_m, dx_m), distance_m)
        if self.s_m >= item.length_m:
            return done()
        bearing_rad = heading_error_rad(pose, item.x_m, item.y_m)
        steering_rad = steer_round(self._law, bearing_rad, distance_m, item.side).steering_rad
        curvature = math.tan(steering_rad) / _WHEELBASE_M
        v_m_s = min(item.speed_m_s, bend_speed(abs(curvature), config))
        turned = f"{self._turned_rad / math.tau:.2f} of {item.turns:g} turns"
        text = f"{turned}, {distance_m:.2f} m from the centre"
        return BehaviourOutput(v_m_s, curvature * v_m_s, text=text)

    def _count(self, around_rad: float, distance_m: float) -> None:
        """Count the way round the centre since the last step; none on the way to the circle."""
        before_rad, self._around_rad = self._around_rad, around_rad
        if before_rad is not None and distance_m < _ON_CIRCLE * self._item.radius_m:
            self._turned_rad += self._sign * wrap_angle(around_rad - before_rad)


def _law(radius_m: float, drive: Drive) -> SteeringLawConfig:
    """Return the law that leads to a circle of a radius [m]."""
    sharpest = min(_WHEELBASE_M * curvature_max(drive), math.tan(_STEERING_MAX_RAD))
    return orbit_config(radius_m, _WHEELBASE_M, _GAIN, math.atan(sharpest))


def _make(item: CircleItem, robot: NavigatedRobot) -> Behaviour:
    return Rearwards(Circle(item, robot.config.pursuit, robot.drive), robot)


def _time_out_s(item: CircleItem) -> float:
    return item.time_out_s or time_for(item.length_m, item.speed_m_s)


def _problems(item: CircleItem, robot: Abilities) -> Iterator[str]:
    least_m = _ROOM * robot.drive.min_turning_radius_m
    if item.radius_m < least_m:
        yield f"radius_m = {item.radius_m:g}: this robot drives circles of {least_m:.2f} m or more"


CIRCLE = Kind(_make, _time_out_s, _problems)
