"""The rungs of the ladder of recoveries: what a robot in trouble tries.

A rung is a class here, an entry of `RUNGS`, and a name in `RungName`, by which files choose it. It
only says which velocity it wants: the obstacle guard slows and stops it like all others.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import ClassVar, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.behaviour import BehaviourInput, BehaviourOutput
from robotctl.planning.behave.journey.tools import JourneyTools
from robotctl.planning.config import RungName
from robotctl.planning.path.local.pursuit import in_base, reachable_curvature

BEHIND_M: Final = (0.05, 0.1, 0.2)
"""Distances behind the robot at which the floor has to be known for it to drive backwards [m]."""
TURNS_RAD: Final = (0.1, 0.2, 0.4)
"""Turns that have to be free for it to begin [rad]."""
_LOOK_BACK_M: Final = 0.25
"""Distance to the point of its own track that a robot steers back to [m]."""


class Trouble(NamedTuple):
    """Trouble of a journey: reason, time and place."""

    reason: str
    """Reason, as text."""
    since_ns: int
    pose: SE2
    """`base` in `world`."""
    ahead: tuple[float, float]
    """Place in `world` that the robot does not get past [m]."""
    track: Sequence[SE2]
    """Poses that it has driven ahead through, the last one first."""


class Rung(ABC):
    """One try to get on.

    Parameters
    ----------
    trouble
        The reason for it.
    tools
        Of the journey.

    Attributes
    ----------
    text
        What the robot does and why, for people.
    """

    words: ClassVar[str]
    """Action of the robot, as text."""
    asks: ClassVar[bool] = False
    """Whether an operator's go-ahead ends it, and all trouble starts over."""
    turns_first: ClassVar[bool] = False
    """Whether the robot looks along the next path before it drives, if it turns on the spot."""
    watches: ClassVar[bool] = False
    """Whether a free path ends it."""

    def __init__(self, trouble: Trouble, tools: JourneyTools) -> None:
        self._trouble = trouble
        self._tools = tools
        self.text = f"{self.words}: {trouble.reason}"

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput | None:
        """Return the next velocity; None once the rung has ended."""
        spent_ns = now_ns - self._trouble.since_ns
        if spent_ns > self._longest_ns():
            return None
        motion = self._motion(situation)
        if motion is None:
            return None
        return BehaviourOutput(*motion, text=self.text, asks=self.asks)

    def _longest_ns(self) -> int:
        """Return the maximum time of the rung [ns]."""
        return _ns(self._tools.journey.rungs.longest_s)

    @abstractmethod
    def _motion(self, situation: BehaviourInput) -> tuple[float, float] | None:
        """Return speed and turning rate [m/s, rad/s]; None: there is nothing left to do."""


class _Stand(Rung):
    """Stands for a while."""

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput | None:
        """Return rest; None once the time is over."""
        over = now_ns - self._trouble.since_ns >= self._longest_ns()
        return None if over else super().step(situation, now_ns)

    def _longest_ns(self) -> int:
        return _ns(self._tools.journey.rungs.pause_s)

    def _motion(self, situation: BehaviourInput) -> tuple[float, float] | None:  # noqa: ARG002
        return 0.0, 0.0


class Wait(_Stand):
    """Waits until there is a free path, but not for long."""

    words = "waiting for what is in the way to move"
    watches = True

    def _longest_ns(self) -> int:
        return _ns(self._tools.journey.rungs.wait_s)


class Replan(_Stand):
    """Plans again after a pause."""

    words = "planning again"


class Clear(_Stand):
    """Forgets what was seen and is not seen now, then plans."""

    words = "forgetting obstacles that it does not see now"

    def __init__(self, trouble: Trouble, tools: JourneyTools) -> None:
        super().__init__(trouble, tools)
        tools.world.forget_unseen()


class OtherWay(_Stand):
    """Plans as if the place ahead were closed, for the rest of the journey."""

    words = "looking for another way"
    turns_first = True

    def __init__(self, trouble: Trouble, tools: JourneyTools) -> None:
        super().__init__(trouble, tools)
        tools.paths.avoid(trouble.ahead)


class BackOff(Rung):
    """Drives straight back."""

    words = "backing off"

    def _motion(self, situation: BehaviourInput) -> tuple[float, float] | None:
        tools, pose, begin = self._tools, situation.pose, self._trouble.pose
        behind = poses_after(pose, [SE2(-x_m, 0.0, 0.0) for x_m in BEHIND_M])
        driven_m = math.dist((pose.x_m, pose.y_m), (begin.x_m, begin.y_m))
        if driven_m >= tools.recovery.back_off_m or not _is_seen_free(tools, behind):
            return None
        return -tools.journey.rungs.back_m_s, 0.0


class Retrace(Rung):
    """Drives back by the way it came, as far as it has driven ahead on that."""

    words = "driving back the way it came"

    def __init__(self, trouble: Trouble, tools: JourneyTools) -> None:
        super().__init__(trouble, tools)
        self._left = list(trouble.track)
        self._driven_m = 0.0
        self._last = trouble.pose

    def _longest_ns(self) -> int:
        slow_s = 2.0 * self._tools.recovery.retrace_m / self._tools.journey.rungs.back_m_s
        return super()._longest_ns() + _ns(slow_s)

    def _motion(self, situation: BehaviourInput) -> tuple[float, float] | None:
        tools, pose = self._tools, situation.pose
        self._driven_m += math.dist((pose.x_m, pose.y_m), (self._last.x_m, self._last.y_m))
        self._last = pose
        while self._left and in_base(pose, self._left[0].x_m, self._left[0].y_m)[0] > -_LOOK_BACK_M:
            self._left.pop(0)
        if not self._left or self._driven_m >= tools.recovery.retrace_m:
            return None
        aim, v = self._left[0], -tools.journey.rungs.back_m_s
        limit = 1.0 / tools.paths.turning_radius_m if tools.paths.steered else math.inf
        x_m, y_m = in_base(pose, aim.x_m, aim.y_m)
        curvature = reachable_curvature(-x_m, y_m, limit)
        behind = poses_after(pose, [SE2.exp(-s_m, 0.0, -s_m * curvature) for s_m in BEHIND_M])
        return (v, curvature * v) if _is_seen_free(tools, behind) else None


class LookAround(Rung):
    """Turns once on the spot."""

    words = "looking around"

    def __init__(self, trouble: Trouble, tools: JourneyTools) -> None:
        super().__init__(trouble, tools)
        self._last_rad = trouble.pose.theta_rad
        self._turned_rad = 0.0

    def _motion(self, situation: BehaviourInput) -> tuple[float, float] | None:
        tools, pose = self._tools, situation.pose
        self._turned_rad += abs(wrap_angle(pose.theta_rad - self._last_rad))
        self._last_rad = pose.theta_rad
        turned = poses_after(pose, [SE2(0.0, 0.0, turn_rad) for turn_rad in TURNS_RAD])
        if self._turned_rad >= math.tau or tools.world.touches(turned):
            return None
        return 0.0, tools.journey.rungs.turn_rad_s


class Ask(_Stand):
    """Asks people: they may say go ahead, skip the item, or choose another mode."""

    words = "asking: go ahead, skip this, RTL or HOLD?"
    asks = watches = True

    def _longest_ns(self) -> int:
        return _ns(self._tools.recovery.ask_s)


RUNGS: Final[Mapping[RungName, type[Rung]]] = {
    "wait": Wait,
    "replan": Replan,
    "clear": Clear,
    "back_off": BackOff,
    "retrace": Retrace,
    "other_way": OtherWay,
    "look_around": LookAround,
    "ask": Ask,
}


def poses_after(pose: SE2, motions: list[SE2]) -> NDArray[np.float64]:
    """Return where each motion leads to, (n, 3)."""
    ends = [pose @ motion for motion in motions]
    return np.array([(end.x_m, end.y_m, end.theta_rad) for end in ends])


def _is_seen_free(tools: JourneyTools, poses: NDArray[np.float64]) -> bool:
    """Return whether the robot has seen the floor at poses (n, 3), and nothing stands there."""
    return tools.world.map.is_known(poses) and not tools.world.touches(poses)


def _ns(time_s: float) -> int:
    """Return a time [ns]."""
    return round(1e9 * time_s)
