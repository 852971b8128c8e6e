"""Inputs and outputs of behaviours."""

from __future__ import annotations

import enum
import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.planning.path.global_planning.goal import Goal


class BehaviourInput(NamedTuple):
    """The robot and its surroundings at one navigation step."""

    pose: SE2
    """`base` in `world`."""
    twist: Twist
    """Present velocity of `base`."""
    ranges_m: tuple[float, ...]
    """One range for each sonar mount [m]: inf without echo, nan if missing, faulty or stale."""
    new: tuple[bool, ...]
    """Which of the ranges are new since the last step."""
    epoch: tuple[int, int] = (0, 0)
    """Changes when the pose jumps, since the robot was found elsewhere."""
    charge: float = math.nan
    """Charge of the battery, in [0, 1]; nan: unknown."""
    markers: Sequence[tuple[int, SE2]] = ()
    """Markers seen since the last step: number, and pose in `world`, x into the marker."""
    go_ahead: bool = False
    """Whether an operator has just said to go on."""


class Status(enum.Enum):
    """Progress of a behaviour."""

    RUNNING = enum.auto()
    DONE = enum.auto()
    FAILED = enum.auto()


class BehaviourOutput(NamedTuple):
    """A behaviour's output: a velocity [m/s, rad/s], its status and a reason or remark."""

    v_m_s: float
    omega_rad_s: float
    status: Status = Status.RUNNING
    text: str = ""
    vy_m_s: float = 0.0
    """Velocity to the left, of holonomic drives."""
    asks: bool = False
    """Whether it waits for an operator's go-ahead."""
    task: str = ""
    """Task that it is part of, as text, such as the item of a mission."""

    @property
    def twist(self) -> Twist:
        """The velocity."""
        return Twist(self.v_m_s, self.omega_rad_s, self.vy_m_s)


def done(text: str = "") -> BehaviourOutput:
    """Return a stop at the end of a behaviour."""
    return BehaviourOutput(0.0, 0.0, Status.DONE, text)


def failed(reason: str) -> BehaviourOutput:
    """Return a stop with the reason why a behaviour gives up."""
    return BehaviourOutput(0.0, 0.0, Status.FAILED, reason)


class Anchor(NamedTuple):
    """Place in `world`, perhaps a heading, where a behaviour continues after an interruption."""

    x_m: float
    y_m: float
    heading_rad: float | None = None


class Behaviour(ABC):
    """A task that the robot performs until it is done or has failed."""

    @property
    def s_m(self) -> float:
        """Distance along a path or wall [m]; 0 if it follows none."""
        return 0.0

    @abstractmethod
    def reset(self) -> None:
        """Start over."""

    @abstractmethod
    def pause(self) -> None:
        """Another mode steers for a while; the next step continues from the robot's new place."""

    @abstractmethod
    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return what to do at `now_ns`, monotonic [ns]; time in a pause does not count."""

    def anchor(self, pose: SE2) -> Anchor | None:  # noqa: ARG002 - for who overrides it
        """Return where a robot found at `pose` continues; None: at no place of its own."""
        return None

    def join(self) -> None:
        """Continue near the anchor, with any heading."""
        self.pause()

    def resume(self, s_m: float) -> None:  # noqa: ARG002 - for who overrides it
        """Continue at distance `s_m` along a path or wall [m], as an earlier run left it."""
        self.reset()

    def redirect(self, goal: Goal, speed_m_s: float) -> None:
        """Drive to another place from now on, at most at a speed [m/s]: that is no new start."""
        raise TypeError(f"{type(self).__name__} drives to no single place: {goal}, {speed_m_s}")


class Stopwatch:
    """Time spent in steps: it stops between a pause and the next step."""

    def __init__(self) -> None:
        self._spent_ns = 0
        self._last_ns: int | None = None

    def pause(self) -> None:
        """Stop until the next step."""
        self._last_ns = None

    def step(self, now_ns: int) -> int:
        """Return the time spent up to this step [ns]."""
        if self._last_ns is not None:
            self._spent_ns += now_ns - self._last_ns
        self._last_ns = now_ns
        return self._spent_ns
