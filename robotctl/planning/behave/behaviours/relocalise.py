"""Behaviour of a robot that does not know its pose: search for it without hitting anything."""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from robotctl.model.drives.drives import Drive
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.behave.behaviours.behaviour import BehaviourInput, BehaviourOutput
from robotctl.planning.behave.behaviours.guarded import limited
from robotctl.planning.guard.obstacle_guard import ObstacleGuard

_BLOCKED_M_S: Final = 0.1
"""Below this allowed speed another direction is tried."""
_TURN_RAD_S: Final = 0.6
_LEAST_TURN_RAD: Final = math.radians(50.0)
_MOST_TURN_RAD: Final = math.radians(200.0)
_BACK_M: Final = 0.5
_FAR_M: Final = 4.0
"""A missing echo counts as this range [m]."""


class _Doing(enum.Enum):
    """Present phase."""

    ROUND = "looking around"
    FORWARD = "looking for a known place"
    TURN = "turning to a free side"
    BACK = "backing up"


class _Way(NamedTuple):
    """Room to drive in one direction."""

    v_max_m_s: float
    """Largest speed [m/s], >= 0."""
    turn_rad_m: float
    """Turn per distance, left > 0 [rad/m]."""


class LookAround:
    """Turn once, then drive wherever there is room; this behaviour never ends.

    It turns as far as its body has room, which is the other way where something stands beside it. A
    drive-and-steer robot cannot turn on the spot: it begins by driving. If its path is blocked,
    it backs up with the wheels turned, so that it faces the freer side, or straight if its nose has
    no room to swing out. Only relative poses are used. Nobody commanded it to move, so it does not
    back up without a rear sonar, and without a front sonar it turns once round, if it can, and
    stops.

    Parameters
    ----------
    drive
        Drive model.
    guard
        Shared with the other behaviours; the navigator feeds it.
    mounts
        The sonars, in the order of the ranges.
    speed_m_s
        Largest speed [m/s].
    """

    def __init__(
        self, drive: Drive, guard: ObstacleGuard, mounts: Sequence[SonarMount], speed_m_s: float
    ) -> None:
        self._drive = drive
        self._guard = guard
        self._sides = tuple(_side(mount) for mount in mounts)
        self.speed_m_s = speed_m_s
        self.reset()

    def reset(self) -> None:
        """Start over."""
        self._doing = _Doing.FORWARD if self._drive.steered else _Doing.ROUND
        self._last: SE2 | None = None
        self._turned_rad = 0.0
        self._moved_m = 0.0
        self._direction = 1.0
        self._has_turned_back = False

    def pause(self) -> None:
        """Another mode steers for a while."""
        self._last = None

    def step(self, situation: BehaviourInput) -> BehaviourOutput:
        """Return the next velocity."""
        self._measure(situation.pose)
        ahead = self._way(1.0)
        # The sum of small turns: a single wrapped heading would not show a full turn.
        if self._doing is _Doing.ROUND and abs(self._turned_rad) >= math.tau:
            self._begin(_Doing.FORWARD)
        blocked = ahead.v_max_m_s < _BLOCKED_M_S and self._guard.looks(1.0)
        if self._doing is _Doing.FORWARD and blocked:
            self._begin(_Doing.BACK if self._drive.steered else _Doing.TURN)
            self._direction = self._freer_side(situation.ranges_m)
        if self._doing is _Doing.TURN and self._has_turned(ahead.v_max_m_s):
            self._begin(_Doing.FORWARD)
        behind = self._way(-1.0)
        if self._doing is _Doing.BACK and self._has_backed(behind.v_max_m_s):
            self._begin(_Doing.FORWARD)
        if self._doing in {_Doing.ROUND, _Doing.TURN}:
            return self._turn()
        sign, room = (1.0, ahead) if self._doing is _Doing.FORWARD else (-1.0, behind)
        speed = min(self.speed_m_s, room.v_max_m_s)
        text = self._blind(blocked=blocked) or self._doing.value
        return BehaviourOutput(sign * speed, speed * room.turn_rad_m, text=text)

    def _turn(self) -> BehaviourOutput:
        """Turn as the body has room; where it has none, the other way, and then give up turning."""
        wanted = BehaviourOutput(0.0, self._direction * _TURN_RAD_S, text=self._doing.value)
        if limited(wanted, self._guard)[0].omega_rad_s == 0.0:
            if self._has_turned_back:
                self._begin(_Doing.FORWARD if self._doing is _Doing.ROUND else _Doing.BACK)
            else:
                self._direction, self._has_turned_back = -self._direction, True
        return wanted

    def _begin(self, doing: _Doing) -> None:
        """Switch to another phase."""
        self._doing = doing
        self._turned_rad = self._moved_m = 0.0
        self._has_turned_back = False

    def _measure(self, pose: SE2) -> None:
        """Add up angle and distance."""
        if self._last is not None:
            self._turned_rad += wrap_angle(pose.theta_rad - self._last.theta_rad)
            self._moved_m += math.hypot(pose.x_m - self._last.x_m, pose.y_m - self._last.y_m)
        self._last = pose

    def _has_turned(self, ahead_m_s: float) -> bool:
        """Return whether the path is free after a real turn, or in a niche after any."""
        turned = abs(self._turned_rad)
        # A niche may be free nowhere: after the largest turn it drives anyway, as far as the guard
        # allows.
        return turned >= _MOST_TURN_RAD or (
            turned >= _LEAST_TURN_RAD and ahead_m_s >= self.speed_m_s
        )

    def _has_backed(self, behind_m_s: float) -> bool:
        """Return whether there is room ahead now, or none behind."""
        return self._moved_m >= _BACK_M or behind_m_s < _BLOCKED_M_S

    def _way(self, direction: float) -> _Way:
        """Return how fast it may drive forwards (1) or backwards (-1), and on which arc."""
        if not self._guard.looks(direction):
            return _Way(0.0, 0.0)
        turn = 0.0
        if self._drive.steered:
            # Ahead in a small bend, or it would come back to where it was stuck.
            turn = self._direction / self._drive.min_turning_radius_m
            turn *= 0.5 if direction > 0.0 else 1.0
        bent = self._guard.step(direction, turn).v_max_m_s
        if bent >= _BLOCKED_M_S:
            return _Way(bent, turn)
        return _Way(self._guard.step(direction).v_max_m_s, 0.0)

    def _blind(self, *, blocked: bool) -> str:
        """Return why it does not drive without a sonar in that direction; empty if it may."""
        if not self._guard.looks(1.0):
            return "no sonar looks ahead"
        if self._drive.steered and blocked and not self._guard.looks(-1.0):
            return "the path is blocked, and there is no rear sonar"
        return ""

    def _freer_side(self, ranges_m: Sequence[float]) -> float:
        """Return 1 if there is more room to the left, else -1."""
        room = 0.0
        for side, range_m in zip(self._sides, ranges_m, strict=True):
            if not math.isnan(range_m):
                room += side * min(range_m, _FAR_M)
        return 1.0 if room >= 0.0 else -1.0


def _side(mount: SonarMount) -> float:
    """Return how far left of the direction of travel a sonar looks, -1 to 1."""
    heading = wrap_angle(mount.heading_rad)
    return math.sin(heading) if abs(heading) <= math.radians(100.0) else 0.0
