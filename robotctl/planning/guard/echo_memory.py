"""Echoes near the robot, kept while no sonar hears them.

Between two sonars of a ring there is a gap, and the edge of a box or the end of a wall that was
heard ahead lies in it when the robot is beside it. So echoes are kept in the frame of the odometry,
on the axis of the sonar that heard them, which is some centimetres off: an echo counts when two in
a row agree, and none does where the robot has been or hears through. What moves is not kept, but it
shows that nothing is before it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.model.footprint import Footprint
from robotctl.model.footprint_arrays import Sides, side_rows
from robotctl.model.geometry.points import moved
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.guard.swept_body import depth_below
from robotctl.planning.guard_config import GuardMemoryConfig

_AXIS_RAD: Final = math.radians(6.0)
"""Angle off its axis within which a sonar that hears something beyond a place shows that nothing is
there."""
_CELL_M: Final = 0.04
"""Side of a square for which one echo is kept [m]: finer than the guard's margin."""


class EchoMemory:
    """Places where the robot has heard something that stands.

    Parameters
    ----------
    mounts
        The sonars, in the order of the ranges.
    body
        The robot.
    config
        See there.
    """

    def __init__(
        self,
        mounts: Sequence[SonarMount],
        body: Footprint,
        config: GuardMemoryConfig = GuardMemoryConfig(),  # noqa: B008
    ) -> None:
        self._config = config
        self._life_ns = round(1e9 * config.life_s)
        self._mounts = [SE2(each.x_m, each.y_m, each.heading_rad) for each in mounts]
        self.use_body(body)
        self.reset()

    def use_body(self, body: Footprint) -> None:
        """Remember round another body from now on."""
        self._body = side_rows(body)

    def reset(self) -> None:
        """Forget everything."""
        self._points = np.empty((0, 2))
        self._heard_ns = np.empty(0, np.int64)
        self._last: list[tuple[float, float] | None] = [None] * len(self._mounts)
        """Last echo of each sonar, in the frame of the odometry."""

    def hear(
        self, T_odom_base: SE2, readings_m: Sequence[float], moves: Sequence[bool], now_ns: int
    ) -> NDArray[np.float64]:
        """Take new readings; return the echoes around in `base`, (n, 2) [m].

        Parameters
        ----------
        T_odom_base
            The robot in the frame of the odometry.
        readings_m
            Of each sonar [m]; inf: no echo, nan: nothing new.
        moves
            Whether each is of something that moves.
        now_ns
            Time of the step [ns].
        """
        beyond_m = self._config.echo_beyond_m
        heard = zip(self._mounts, readings_m, moves, strict=True)
        for slot, (mount, reading, is_moving) in enumerate(heard):
            if math.isfinite(reading):  # without an echo it may look along a wall
                sonar = T_odom_base @ mount
                if len(self._points):
                    axis = sonar.x_m, sonar.y_m, sonar.theta_rad
                    self._keep(_may_stand(self._points, axis, reading, beyond_m))
                if not is_moving:
                    self._take(slot, sonar, reading, now_ns)
        if not len(self._points):
            return self._points
        around = moved(T_odom_base.inverse(), self._points)
        kept_m, since_ns = self._config.echo_kept_m, now_ns - self._life_ns
        kept = _is_kept(around, self._heard_ns, self._body, kept_m, since_ns)
        self._keep(kept)
        near: NDArray[np.float64] = around[kept]
        return near

    def _take(self, slot: int, sonar: SE2, reading: float, now_ns: int) -> None:
        """Keep an echo, if the one before agrees."""
        last, self._last[slot] = self._last[slot], None
        if reading > self._config.echo_range_m:
            return
        point = sonar.apply(reading, 0.0)
        self._last[slot] = point
        if last is None or math.dist(last, point) > self._config.echo_same_m:
            return
        if len(self._points):
            self._keep(_is_apart(self._points, *point))
        self._points = np.concatenate([self._points, [point]])
        self._heard_ns = np.append(self._heard_ns, now_ns)

    def _keep(self, kept: NDArray[np.bool_]) -> None:
        if np.count_nonzero(kept) < len(kept):  # a fifth of the time of all()
            self._points, self._heard_ns = self._points[kept], self._heard_ns[kept]


@compiled
def _may_stand(
    points: NDArray[np.float64], axis: tuple[float, float, float], reading: float, beyond_m: float
) -> NDArray[np.bool_]:
    """Return beyond which points a sonar hears nothing, (n,); `axis` is its place and heading."""
    x, y, heading = axis
    c, s = math.cos(heading), math.sin(heading)
    kept = np.ones(len(points), np.bool_)
    for number in range(len(points)):
        dx, dy = points[number, 0] - x, points[number, 1] - y
        if math.hypot(dx, dy) + beyond_m < reading:
            off = math.atan2(c * dy - s * dx, c * dx + s * dy)
            kept[number] = abs(off) >= _AXIS_RAD
    return kept


@compiled
def _is_kept(
    points: NDArray[np.float64],
    heard_ns: NDArray[np.int64],
    body: Sides,
    kept_m: float,
    since_ns: int,
) -> NDArray[np.bool_]:
    """Return which points in `base` are near, not too old, and not where the robot stands, (n,)."""
    kept = np.empty(len(points), np.bool_)
    for number in range(len(points)):
        x, y = points[number, 0], points[number, 1]
        covered = depth_below(body, x, y) > 0.0
        near = math.hypot(x, y) <= kept_m
        kept[number] = near and heard_ns[number] >= since_ns and not covered
    return kept


@compiled
def _is_apart(points: NDArray[np.float64], x: float, y: float) -> NDArray[np.bool_]:
    """Return which points are not in the square of a new one, (n,)."""
    kept = np.empty(len(points), np.bool_)
    for number in range(len(points)):
        kept[number] = math.hypot(points[number, 0] - x, points[number, 1] - y) >= _CELL_M
    return kept
