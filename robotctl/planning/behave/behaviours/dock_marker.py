"""The behaviour that docks to a marker: along its axis, square to it, at a distance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from robotctl.model.drives.drives import Drive
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.behaviour import (
    Behaviour,
    BehaviourInput,
    BehaviourOutput,
    Stopwatch,
    done,
    failed,
)
from robotctl.planning.behave.behaviours.docking import (
    NEAR_M,
    SKEW_MAX_RAD,
    SQUARE_RAD,
    approach_speed,
    turn,
)
from robotctl.planning.path.local.pursuit import curvature_max, reachable_curvature

_KEPT: Final = 8
"""Views whose mean counts: one alone is uncertain by degrees from afar."""
_LOOK_NS: Final = 5_000_000_000
"""Maximum wait for the marker [ns]."""
_LOST_M: Final = 0.6
"""Way that a robot drives at most by where it last saw the marker [m]."""
_AHEAD_M: Final = 0.4
"""Distance along the marker's axis to the point that it steers to [m]."""
_TURN_RAD: Final = math.radians(45.0)
"""A robot that turns on the spot does so where the point is farther aside."""
_ASIDE_MAX_M: Final = 0.05


class DockAtMarker(Behaviour):
    """Drives to a marker along the line square to it, and stops before it.

    Parameters
    ----------
    marker
        Its number.
    distance_m
        Between the robot's foremost point and the marker at the end [m].
    speed_m_s
        Largest speed [m/s].
    front_m
        The foremost point, ahead of `base` [m].
    drive
        Whether it turns on the spot, and how sharply it steers.
    """

    def __init__(
        self, marker: int, distance_m: float, speed_m_s: float, front_m: float, drive: Drive
    ) -> None:
        self._marker = marker
        self._stop_m = distance_m + front_m
        self._front_m = front_m
        self._speed_m_s = speed_m_s
        self._turns = not drive.steered
        self._curvature_max = curvature_max(drive)
        self.reset()

    def reset(self) -> None:
        """Start over."""
        self._is_there = False
        self._views: list[SE2] = []
        self._seen_at: SE2 | None = None
        self.pause()

    def pause(self) -> None:
        """Keep where the marker is; near it the robot may have turned away from it."""
        self._watch = Stopwatch()

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return the next velocity; done square before the marker."""
        pose = situation.pose
        for number, T_world_marker in situation.markers:
            if number == self._marker:
                self._views = [*self._views[1 - _KEPT :], T_world_marker]
                self._seen_at = pose
        if self._seen_at is None or math.dist(_place(pose), _place(self._seen_at)) > _LOST_M:
            if self._watch.step(now_ns) > _LOOK_NS:
                return failed(f"the camera does not see marker {self._marker}")
            return BehaviourOutput(0.0, 0.0, text=f"looks for marker {self._marker}")
        self._watch = Stopwatch()
        here = _mean(self._views).inverse() @ pose
        gap_m = -here.x_m - self._front_m
        text = f"{gap_m:.2f} m from marker {self._marker}, {abs(here.y_m):.2f} m beside its axis"
        left_m = -here.x_m - self._stop_m
        if not self._is_there and left_m > NEAR_M:
            return self._approach(here, left_m, text)
        self._is_there = True
        return self._square(here, text)

    def _approach(self, here: SE2, left_m: float, text: str) -> BehaviourOutput:
        """Steer to a point of the axis ahead; `here` is `base` seen from the marker."""
        x_m, y_m = here.inverse().apply(here.x_m + _AHEAD_M, 0.0)
        aside_rad = math.atan2(y_m, x_m)
        if self._turns and abs(aside_rad) > _TURN_RAD:
            return turn(aside_rad, text)
        v = approach_speed(left_m, self._speed_m_s)
        curvature = reachable_curvature(x_m, y_m, self._curvature_max)
        return BehaviourOutput(v, curvature * v, text=text)

    def _square(self, here: SE2, text: str) -> BehaviourOutput:
        """Turn square if that can be done on the spot; say where it stands."""
        skew_rad = -here.theta_rad
        if self._turns and abs(skew_rad) > SQUARE_RAD:
            return turn(skew_rad, text)
        if abs(here.y_m) > _ASIDE_MAX_M or abs(skew_rad) > SKEW_MAX_RAD:
            return failed(f"not before it: {text}, {math.degrees(skew_rad):.0f} deg askew")
        return done(text)


def _place(pose: SE2) -> tuple[float, float]:
    return pose.x_m, pose.y_m


def _mean(views: Sequence[SE2]) -> SE2:
    """Return the mean of poses."""
    count = len(views)
    x_m, y_m = sum(view.x_m for view in views) / count, sum(view.y_m for view in views) / count
    sines = sum(math.sin(view.theta_rad) for view in views)
    cosines = sum(math.cos(view.theta_rad) for view in views)
    return SE2(x_m, y_m, math.atan2(sines, cosines))
