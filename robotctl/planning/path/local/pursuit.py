"""Pure pursuit: steer along the arc to a point of the path a little ahead.

R. C. Coulter, *Implementation of the Pure Pursuit Path Tracking Algorithm*, CMU-RI-TR-92-01: the
arc through `base`, along its heading, to the point (x, y) in `base` has the curvature 2 y / (x^2 +
y^2). The same holds in reverse for a point behind. A differential drive that looks far away from
the path turns on the spot first; drive-and-steer robots only get arcs within
their reach.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from robotctl.model.drives.drives import Drive
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.planning.config import PursuitConfig
from robotctl.planning.path.local.path import Path


class PursuitStep(NamedTuple):
    """One step along a path."""

    v_m_s: float
    omega_rad_s: float
    remaining_m: float
    """Way left along the path [m]."""
    off_path_m: float
    """Distance from the path [m]."""
    done: bool
    """The end of the path is reached."""


class Pursuit:
    """Follows one path once, forwards or in reverse gear.

    Parameters
    ----------
    path
        The path, in `world`.
    config
        See there.
    drive
        Says whether the robot can turn on the spot and how tightly it can drive.
    speed_m_s
        Wanted speed [m/s], > 0; less at the goal and in bends.
    reverse
        Drive backwards along the path. The robot then never turns on the spot.
    """

    def __init__(
        self,
        path: Path,
        config: PursuitConfig,
        drive: Drive,
        speed_m_s: float,
        *,
        reverse: bool = False,
    ) -> None:
        self._path = path
        self._config = config
        self._speed = speed_m_s
        self._gear = -1.0 if reverse else 1.0
        self._turns_on_spot = not drive.steered and not reverse
        self._curvature_max = curvature_max(drive)
        self._caps = _vertex_speeds(path, config, speed_m_s)
        self.reset()

    def reset(self, s_m: float = 0.0) -> None:
        """Begin at the length `s_m` along the path [m], by default at its start."""
        self._s = min(max(s_m, 0.0), self._path.length_m)
        self._turning = False

    @property
    def s_m(self) -> float:
        """Length along the path up to where the robot is [m]."""
        return self._s

    def step(self, pose: SE2, twist: Twist) -> PursuitStep:
        """Return the velocity for a robot at `pose` in `world` that moves with `twist`."""
        config, path = self._config, self._path
        lookahead = min(
            max(config.lookahead_s * abs(twist.v_m_s), config.lookahead_min_m),
            config.lookahead_max_m,
        )
        # Search only this far ahead, so that a path that crosses itself cannot be cut short.
        window = self._s + lookahead + config.off_path_max_m
        self._s, off_path = path.project(pose.x_m, pose.y_m, self._s, window)
        remaining = path.length_m - self._s
        if remaining <= config.goal_tolerance_m:
            return PursuitStep(0.0, 0.0, remaining, off_path, True)
        x, y = in_base(pose, *path.point_at(self._s + lookahead))
        bearing = math.atan2(y, x)
        if self._turns_on_spot and self._must_turn(bearing):
            omega = turn_rate(bearing, config)
            return PursuitStep(0.0, omega, remaining, off_path, False)
        curvature = reachable_curvature(self._gear * x, y, self._curvature_max)
        v = min(self._speed_here(), bend_speed(abs(curvature), config))
        # Without a minimum speed it would approach the goal ever more slowly.
        v = self._gear * max(v, min(config.creep_m_s, self._speed))
        return PursuitStep(v, curvature * v, remaining, off_path, False)

    def _must_turn(self, bearing_rad: float) -> bool:
        """Say whether to turn on the spot; once begun, until the point is nearly ahead."""
        limit = self._config.turned_deg if self._turning else self._config.turn_on_spot_deg
        self._turning = abs(bearing_rad) > math.radians(limit)
        return self._turning

    def _speed_here(self) -> float:
        """Return the speed from which the next corner's and the goal's can be reached [m/s]."""
        vertex = self._path.segment_at(self._s) + 1
        way = max(self._path.vertex_s_m(vertex) - self._s, 0.0)
        slow = self._caps[vertex]
        return min(self._speed, math.sqrt(slow * slow + 2.0 * self._config.acceleration_m_s2 * way))


def curvature_max(drive: Drive) -> float:
    """Return the curvature of the tightest arc that a robot can drive [1/m]; inf: none is."""
    radius_m = drive.min_turning_radius_m
    return 1.0 / radius_m if radius_m > 0.0 else math.inf


def reachable_curvature(x_m: float, y_m: float, limit: float) -> float:
    """Return the curvature of the arc to a point, as far as the robot can bend [1/m].

    `x_m` is positive in the direction of travel and `y_m` to the left [m]. Towards a point behind
    the robot turns as tightly as it can: the arc there would be a detour ever wider, the straighter
    behind the point lies.
    """
    if x_m < 0.0 and limit < math.inf:
        return math.copysign(limit, y_m)
    squared = x_m * x_m + y_m * y_m
    # Pure pursuit: the arc through the point, tangent to the heading (Coulter 1992).
    curvature = 2.0 * y_m / squared if squared > 1e-9 else 0.0
    return min(max(curvature, -limit), limit)


def turn_rate(error_rad: float, config: PursuitConfig) -> float:
    """Return the turn rate that closes a heading error on the spot [rad/s].

    sqrt(2 alpha |error|), so that the deceleration is constant, and proportional close to 0.
    """
    size = abs(error_rad)
    rate = min(math.sqrt(2.0 * config.alpha_rad_s2 * size), 4.0 * size, config.omega_max_rad_s)
    return math.copysign(rate, error_rad)


def miss_m(pose: SE2, x_m: float, y_m: float, radius_m: float) -> float:
    """Return by how much arcs of at least `radius_m` miss a point of `world` [m].

    0 outside of both smallest turning circles, where one arc from `pose` leads to the point.
    """
    x, y = in_base(pose, x_m, y_m)
    return max(radius_m - math.hypot(x, abs(y) - radius_m), 0.0)


def heading_error_rad(pose: SE2, x_m: float, y_m: float) -> float:
    """Return the bearing of a point of `world` seen from `base`, positive left [rad]."""
    return wrap_angle(math.atan2(y_m - pose.y_m, x_m - pose.x_m) - pose.theta_rad)


def in_base(pose: SE2, x_m: float, y_m: float) -> tuple[float, float]:
    """Return a point of `world` in `base` [m]."""
    c, s = math.cos(pose.theta_rad), math.sin(pose.theta_rad)
    dx, dy = x_m - pose.x_m, y_m - pose.y_m
    return c * dx + s * dy, c * dy - s * dx


def bend_speed(curvature: float, config: PursuitConfig) -> float:
    """Return the largest speed in a bend of `curvature` >= 0 [1/m], in m/s."""
    if curvature <= 0.0:
        return math.inf
    return min(
        math.sqrt(config.lateral_acceleration_m_s2 / curvature),
        config.omega_max_rad_s / curvature,
    )


def _vertex_speeds(path: Path, config: PursuitConfig, speed_m_s: float) -> list[float]:
    """Return the largest speed at each point of the path, the last being the goal's 0 [m/s].

    A corner counts as a bend over half of its neighbouring segments, but not more than over the
    shortest look-ahead, within which pursuit rounds it.
    """
    last = len(path.points) - 1
    speeds = [speed_m_s] * last + [0.0]
    for i in range(last - 1, 0, -1):
        before = path.vertex_s_m(i) - path.vertex_s_m(i - 1)
        after = path.vertex_s_m(i + 1) - path.vertex_s_m(i)
        bend = abs(path.turn_rad(i)) / min(0.5 * (before + after), config.lookahead_min_m)
        reachable = math.sqrt(speeds[i + 1] ** 2 + 2.0 * config.acceleration_m_s2 * after)
        speeds[i] = min(speed_m_s, bend_speed(bend, config), reachable)
    return speeds
