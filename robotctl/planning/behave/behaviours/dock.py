"""The behaviour that docks: square to what is ahead, and at a distance from it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal

from robotctl.model.drives.drives import Drive
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.behave.behaviours.behaviour import (
    Behaviour,
    BehaviourInput,
    BehaviourOutput,
    Stopwatch,
    done,
    failed,
)
from robotctl.planning.behave.behaviours.dock_marker import DockAtMarker
from robotctl.planning.behave.behaviours.docking import (
    NEAR_M,
    SKEW_MAX_RAD,
    SQUARE_RAD,
    approach_speed,
    turn,
)
from robotctl.planning.behave.behaviours.item import require_positive
from robotctl.planning.behave.behaviours.kind import Abilities, Kind, NavigatedRobot, out_of_reach
from robotctl.planning.behave.behaviours.wall_ahead import SONARS, WallAhead
from robotctl.planning.path.local.pursuit import curvature_max

_BEND_M: Final = 0.3
"""Way over which a skew is steered out [m]."""
_STANDS_RAD_S: Final = 0.05
_STANDS_STEPS: Final = 8
"""Steps in which a robot at rest looks whether it is square: its sonars have looked again then."""
_LOOK_NS: Final = 2_000_000_000


@dataclass(frozen=True, slots=True)
class DockItem:
    """Drive to a wall ahead or to a marker, and stop square to it at a distance.

    Parameters
    ----------
    kind
        Always "dock".
    distance_m
        Between the front sonar and the wall, or the foremost point and the marker [m], > 0.
    marker
        Number of a marker that the camera sees; None: to the wall ahead, by sonar.
    speed_m_s
        Largest speed [m/s], > 0.
    name
        Name shown to people.
    time_out_s
        The item fails after this time [s], > 0.
    """

    kind: Literal["dock"]
    distance_m: float
    marker: int | None = None
    speed_m_s: float = 0.15
    name: str = ""
    time_out_s: float = 60.0

    def __post_init__(self) -> None:
        require_positive(self, "distance_m", "speed_m_s", "time_out_s")


class DockAtWall(Behaviour):
    """Turns square to the wall, drives up to it, and turns square again.

    A robot that cannot turn on the spot steers out its skew on the way.

    Parameters
    ----------
    item
        Distance and speed.
    mounts
        The sonars: one to the front, and one to each side of that.
    drive
        Whether it turns on the spot, and how sharply it steers.
    """

    def __init__(self, item: DockItem, mounts: Sequence[SonarMount], drive: Drive) -> None:
        self._item = item
        self._wall = WallAhead(mounts)
        self._turns = not drive.steered
        self._curvature_max = curvature_max(drive)
        self.reset()

    def reset(self) -> None:
        """Start over."""
        self._is_there = False
        self.pause()

    def pause(self) -> None:
        """Measure the wall again after the pause, and turn square to it first."""
        self._wall.reset()
        self._is_square = not self._turns
        self._stood = 0
        self._watch = Stopwatch()

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return the next velocity; done square at the distance."""
        self._wall.see(situation)
        pose = situation.pose
        gap_m = self._wall.distance_m(pose)
        if gap_m is None:
            if self._watch.step(now_ns) > _LOOK_NS:
                return failed("the front sonar sees no wall ahead")
            return BehaviourOutput(0.0, 0.0, text="looks for the wall ahead")
        self._watch = Stopwatch()
        normal_rad = self._wall.normal_rad
        skew_rad = 0.0 if normal_rad is None else wrap_angle(normal_rad - pose.theta_rad)
        text = f"{gap_m:.2f} m from the wall, {math.degrees(skew_rad):.0f} deg off square"
        if not self._is_square:
            return self._turn(skew_rad, situation, text)
        left_m = gap_m - self._item.distance_m
        if not self._is_there and abs(left_m) > NEAR_M:
            return self._approach(left_m, skew_rad, text)
        if self._is_there or not self._turns:
            off = abs(skew_rad) > SKEW_MAX_RAD
            return failed(f"stands askew: {text}") if off else done(text)
        self._is_there, self._is_square = True, False
        return BehaviourOutput(0.0, 0.0, text=text)

    def _turn(self, skew_rad: float, situation: BehaviourInput, text: str) -> BehaviourOutput:
        """Turn on the spot; square after a look at rest."""
        if abs(skew_rad) > SQUARE_RAD:
            self._stood = 0
            return turn(skew_rad, text)
        self._stood += abs(situation.twist.omega_rad_s) < _STANDS_RAD_S
        self._is_square = self._stood >= _STANDS_STEPS
        return BehaviourOutput(0.0, 0.0, text=text)

    def _approach(self, left_m: float, skew_rad: float, text: str) -> BehaviourOutput:
        """Drive up to the distance, or back to it, and steer out the skew."""
        v = math.copysign(approach_speed(abs(left_m), self._item.speed_m_s), left_m)
        curvature = skew_rad / _BEND_M if left_m > 0.0 else 0.0
        curvature = min(max(curvature, -self._curvature_max), self._curvature_max)
        return BehaviourOutput(v, curvature * v, text=text)


def _make(item: DockItem, robot: NavigatedRobot) -> Behaviour:
    if item.marker is None:
        return DockAtWall(item, robot.mounts, robot.drive)
    front_m = robot.guard.body.front_m
    return DockAtMarker(item.marker, item.distance_m, item.speed_m_s, front_m, robot.drive)


def _time_out_s(item: DockItem) -> float:
    return item.time_out_s


def _problems(item: DockItem, robot: Abilities) -> Iterator[str]:
    if item.marker is not None and not robot.sees_markers:
        yield "this robot has no camera that looks for markers; see [camera.markers]"
    for side in SONARS if item.marker is None else ():
        if side not in robot.sides:
            yield f"this robot has no sonar that looks to the {side.replace('_', ' ')}"
    yield from out_of_reach(item.distance_m, robot.guard)


DOCK = Kind(_make, _time_out_s, _problems)
