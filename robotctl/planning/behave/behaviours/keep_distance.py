"""The behaviour that keeps a distance to what is ahead: servoing by the front sonar."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal

from robotctl.control.servoing import ServoConfig, gain_without_overshoot, servo
from robotctl.planning.behave.behaviours.behaviour import (
    Behaviour,
    BehaviourInput,
    BehaviourOutput,
    Stopwatch,
    done,
    failed,
)
from robotctl.planning.behave.behaviours.item import require_positive
from robotctl.planning.behave.behaviours.kind import Abilities, Kind, NavigatedRobot, out_of_reach
from robotctl.planning.guard.sonars import sonar_towards
from robotctl.planning.path.local.heading_control import turn_towards

_DELAY_S: Final = 0.4
"""Delay from a change of the distance to the change of speed [s]: a round of the sonars, the median
of three readings, a step of the navigator and the motors."""
_TOLERANCE_M: Final = 0.02
"""Error within which the robot stands: the noise of a sonar must not drive it."""
_LOST_NS: Final = 10_000_000_000
"""Time without an echo after which the item fails [ns]."""
_KEPT: Final = 3
"""Readings whose median counts."""


@dataclass(frozen=True, slots=True)
class KeepDistanceItem:
    """Keep a distance to what is straight ahead, following it and backing up before it.

    Parameters
    ----------
    kind
        Always "keep_distance".
    distance_m
        Reading of the front sonar to keep [m], > 0.
    duration_s
        How long [s], > 0.
    speed_m_s
        Largest speed [m/s], > 0.
    name
        Name shown to people.
    """

    kind: Literal["keep_distance"]
    distance_m: float
    duration_s: float
    speed_m_s: float = 0.3
    name: str = ""

    def __post_init__(self) -> None:
        require_positive(self, "distance_m", "duration_s", "speed_m_s")


class KeepDistance(Behaviour):
    """Servos the speed on the front sonar; a robot that can turn on the spot holds its heading.

    It stands without an echo and without a reading. Where nothing looks back it does not back up.

    Parameters
    ----------
    item
        Distance, duration and speed.
    robot
        Its sonars, the rate of its navigator, and whether it sees behind itself.

    Raises
    ------
    ValueError
        If no sonar looks to the front.
    """

    def __init__(self, item: KeepDistanceItem, robot: NavigatedRobot) -> None:
        front = sonar_towards(robot.mounts, "front")
        if front is None:
            raise ValueError("no sonar looks to the front")
        self._item, self._front = item, front
        self._sees_back = robot.guard.looks(-1.0)
        self._holds_heading = not robot.drive.steered
        dt_s = 1.0 / robot.config.rate_hz
        # The faster it comes, the smaller is the reading's rate: 1 m/s for each m/s, direction -1.
        gain = gain_without_overshoot(1.0, dt_s, round(_DELAY_S / dt_s))
        self._servo = ServoConfig(gain, -1, item.speed_m_s, _TOLERANCE_M)
        self._duration_ns = round(item.duration_s * 1e9)
        self.reset()

    def reset(self) -> None:
        """Start over, with the full duration."""
        self._watch = Stopwatch()
        self.pause()

    def pause(self) -> None:
        """Keep the time spent; what is ahead may be another thing after the pause."""
        self._watch.pause()
        self._unseen = Stopwatch()
        self._readings: list[float] = []
        self._heading_rad: float | None = None

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return the next velocity; done after the duration."""
        if self._watch.step(now_ns) >= self._duration_ns:
            return done()
        range_m = self._reading(situation)
        if not math.isfinite(range_m):
            if self._unseen.step(now_ns) > _LOST_NS:
                return failed(f"the front sonar has seen nothing for {_LOST_NS / 1e9:g} s")
            return BehaviourOutput(0.0, 0.0, text="stands: the front sonar sees nothing")
        self._unseen = Stopwatch()
        v_m_s = servo(self._servo, self._item.distance_m, range_m)
        text = f"{range_m:.2f} m to what is ahead, {self._item.distance_m:g} m wanted"
        if v_m_s < 0.0 and not self._sees_back:
            return BehaviourOutput(0.0, 0.0, text=f"{text}, backing up needs a rear sonar")
        return BehaviourOutput(v_m_s, self._turn(situation.pose.theta_rad), text=text)

    def _reading(self, situation: BehaviourInput) -> float:
        """Return the median of the last readings [m]; a missing one (nan) counts at once."""
        reading = situation.ranges_m[self._front]
        if math.isnan(reading):
            self._readings.clear()
            return reading
        if situation.new[self._front] or not self._readings:
            self._readings = [*self._readings, reading][-_KEPT:]
        return sorted(self._readings)[(len(self._readings) - 1) // 2]

    def _turn(self, theta_rad: float) -> float:
        """Return the turning rate back to the heading of the first step [rad/s]."""
        if self._heading_rad is None:
            self._heading_rad = theta_rad
        return turn_towards(self._heading_rad, theta_rad) if self._holds_heading else 0.0


def _make(item: KeepDistanceItem, robot: NavigatedRobot) -> KeepDistance:
    return KeepDistance(item, robot)


def _problems(item: KeepDistanceItem, robot: Abilities) -> Iterator[str]:
    if "front" not in robot.sides:
        yield "this robot has no sonar that looks to the front"
    yield from out_of_reach(item.distance_m, robot.guard)


KEEP_DISTANCE = Kind(_make, problems=_problems)
