"""A wall ahead by three sonars: how far it is, and where it faces."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.behave.behaviours.behaviour import BehaviourInput
from robotctl.planning.guard.sonars import sonar_towards

SONARS: Final = ("front", "front_left", "front_right")
"""Sonars that see the wall."""

_KEPT: Final = 3
_HALF_BEAM_RAD: Final = math.radians(12.0)
"""A sonar hears what is this far off its axis: small ranging modules, 25 degrees in all."""
_LEAST_RAD: Final = math.radians(3.0)
"""Skew at least, where only one of the two sonars beside the front one hears the wall."""
_SAME_WALL: Final = 0.9, 1.8
"""Shares of the distance of the wall within which an echo from aside is one of that wall."""


class _Reading(NamedTuple):
    """One range [m], inf without an echo, and where `base` was then."""

    range_m: float
    pose: SE2


class _Aside(NamedTuple):
    """Range and angle of the wall as a sonar beside the front one measures it."""

    sees: bool
    is_hidden: bool
    """Something nearer hides the wall from it."""
    skew_rad: float
    """Angle of the wall's normal, left of forward [rad]."""


class WallAhead:
    """Finds the wall that the front sonar looks at.

    Sonars that look aside of the front meet the wall at the same angle where the robot is square
    to it, and measure the same then; askew, the nearer one measures less, or only that one gets an
    echo at all, since a smooth wall throws back nothing that meets it too flatly. In a corner the
    other wall may hide this one from one of them. What neither hears keeps its last word. Medians
    of the last three readings, each at its own pose, keep outliers out and cost no delay.

    Parameters
    ----------
    mounts
        Sonars, in the order of the ranges; `SONARS` are among them.
    """

    def __init__(self, mounts: Sequence[SonarMount]) -> None:
        found = [sonar_towards(mounts, direction) for direction in SONARS]
        self._indices = [index for index in found if index is not None]
        self._mounts = [mounts[index] for index in self._indices]
        self.reset()

    def reset(self) -> None:
        """Forget the wall."""
        self._past: list[list[_Reading]] = [[] for _ in self._indices]
        self.normal_rad: float | None = None
        """Heading of `world` that is square to the wall [rad]; None: it shows nowhere."""

    def see(self, situation: BehaviourInput) -> None:
        """Take in new readings."""
        for past, index in zip(self._past, self._indices, strict=True):
            reading = situation.ranges_m[index]
            if situation.new[index] and not math.isnan(reading):
                past.append(_Reading(reading, situation.pose))
                del past[:-_KEPT]
        self._find_normal()

    def distance_m(self, pose: SE2) -> float | None:
        """Return how far the wall is from the front sonar now [m]; None: there is none."""
        front = self._past[0]
        if len(front) < _KEPT:
            return None
        gaps = sorted(each.range_m - _ahead_m(each.pose, pose) for each in front)
        middle = gaps[_KEPT // 2]
        return middle if math.isfinite(middle) else None

    def _find_normal(self) -> None:
        """Find out where the wall faces."""
        front, left, right = map(_median, self._past)
        if front is None or left is None or right is None or not math.isfinite(front.range_m):
            return
        on_left, on_right = self._aside(front, left, 1), self._aside(front, right, 2)
        at_left, at_right = left.pose.theta_rad, right.pose.theta_rad
        if on_left.sees and on_right.sees:  # the same angle from both: no matter how wide a beam is
            between_rad = at_left + 0.5 * wrap_angle(at_right - at_left)
            self.normal_rad = between_rad + 0.5 * (on_left.skew_rad + on_right.skew_rad)
        elif on_left.sees:
            least_rad = -math.pi if on_right.is_hidden else _LEAST_RAD
            self.normal_rad = at_left + max(on_left.skew_rad, least_rad)
        elif on_right.sees:
            most_rad = math.pi if on_left.is_hidden else -_LEAST_RAD
            self.normal_rad = at_right + min(on_right.skew_rad, most_rad)
        elif self.normal_rad is None:  # beams that are too narrow to meet a wall ahead
            self.normal_rad = front.pose.theta_rad

    def _aside(self, front: _Reading, reading: _Reading, number: int) -> _Aside:
        """Return what an echo from aside says of the wall.

        A beam whose inner edge looks `edge` off the normal of a wall measures gap / cos(edge).
        """
        mount = self._mounts[number]
        gap_m = front.range_m + self._mounts[0].x_m - mount.x_m
        least, most = _SAME_WALL
        if not least * gap_m <= reading.range_m <= most * gap_m:
            return _Aside(sees=False, is_hidden=reading.range_m < gap_m, skew_rad=0.0)
        aside_rad = abs(wrap_angle(mount.heading_rad)) - _HALF_BEAM_RAD
        skew_rad = aside_rad - math.acos(min(gap_m / reading.range_m, 1.0))
        return _Aside(
            sees=True, is_hidden=False, skew_rad=math.copysign(1.0, mount.heading_rad) * skew_rad
        )


def _median(past: Sequence[_Reading]) -> _Reading | None:
    """Return the reading in the middle; None before there are enough."""
    if len(past) < _KEPT:
        return None
    return sorted(past, key=lambda each: each.range_m)[_KEPT // 2]


def _ahead_m(then: SE2, now: SE2) -> float:
    """Return how far `base` has come along its present heading [m]."""
    dx, dy = now.x_m - then.x_m, now.y_m - then.y_m
    return dx * math.cos(now.theta_rad) + dy * math.sin(now.theta_rad)
