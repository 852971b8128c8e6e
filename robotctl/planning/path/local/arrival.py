"""The last piece of a path: position and heading within tolerance, without dithering.

A robot that turns on the spot drives to the position, then turns once to the heading; small errors
beside the way are left as they are. One that steers stays on the path up to its end, and up to each
change of gear, as each robot does in narrow places: by feedback over the way driven, with y beside
the path and the error theta of the heading, theta changes per length by -k^2 y - 2 k theta more
than the path bends, so that both fade as exp(-k s) (C. Samson, "Control of chained systems", 1995,
in its linear form).
"""

from __future__ import annotations

import enum
import math
from typing import Final, NamedTuple

import numpy as np

from robotctl.model.drives.drives import Drive
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.path.local.controller import ControllerConfig
from robotctl.planning.path.local.track import Track

_BESIDE: Final = 0.3
"""Share of the tolerance that the position may be off beside the way."""
_PREVIEW_M: Final = 0.6
"""Distance ahead over which bends count: the wheels turn over less."""
_LATE_M: Final = 0.04
"""Distance over which a change of the bend may be spread [m]."""
_ASTRAY_RAD: Final = 0.3
_SLOW_M_S: Final = 0.1
"""Error of the heading beyond which the robot only drives that fast [rad], [m/s]."""
_IN_LINE_RAD: Final = 0.1
"""Error of the heading beyond which one that can turn on the spot does so [rad]."""


class _Phase(enum.Enum):
    DRIVE = enum.auto()
    TURN = enum.auto()
    STAND = enum.auto()


class ArrivalStep(NamedTuple):
    """Decision of one step: where the robot is to go."""

    v_m_s: float
    omega_rad_s: float
    arrived: bool
    missed: bool
    """Whether it stands and cannot reach the goal from here without another path."""
    vy_m_s: float = 0.0


class Arrival:
    """Drives to the last pose of a path.

    Parameters
    ----------
    config
        Its tolerances and deceleration count.
    drive
        Says whether the robot can turn on the spot and how tightly it can drive.
    omega_max_rad_s, alpha_rad_s2
        Fastest turn, and deceleration planned for the end of a turn.
    """

    def __init__(
        self, config: ControllerConfig, drive: Drive, omega_max_rad_s: float, alpha_rad_s2: float
    ) -> None:
        self._config = config
        self._radius = drive.min_turning_radius_m
        self._turn_over_s = 0.0
        """Time that it takes to bend the path by 1 rad/m more [s m]."""
        if drive.joint_names:
            reach_rad = drive.joint_max_rad[0]
            self._turn_over_s = reach_rad * self._radius / drive.joint_rate_max_rad_s[0]
        self._omega_max = omega_max_rad_s
        self._alpha = alpha_rad_s2
        self._curvature = 0.0
        """Curvature to which the wheels are turned by now."""
        self.near_m = config.near_steered_m if drive.steered else config.near_m
        self.reset()

    def reset(self) -> None:
        """Begin again."""
        self._phase = _Phase.DRIVE

    def step(self, pose: SE2, goal: SE2, speed_m_s: float) -> ArrivalStep:
        """Return the next velocity for a robot near the goal that turns on the spot."""
        off = pose.inverse() @ goal
        distance = math.hypot(off.x_m, off.y_m)
        if self._phase is not _Phase.DRIVE and self._has_left(distance, off.theta_rad):
            self._phase = _Phase.DRIVE
        if self._phase is _Phase.DRIVE:
            if not self._is_there(off, distance):
                return self._drive(off, distance, speed_m_s)
            self._phase = _Phase.TURN
        if self._phase is _Phase.TURN:
            error = off.theta_rad
            if abs(error) > self._config.inside_share * self._config.heading_tolerance_rad:
                return ArrivalStep(0.0, self._turn(error), False, False)
            self._phase = _Phase.STAND
        return ArrivalStep(0.0, 0.0, True, False)

    def slide(self, pose: SE2, goal: SE2, speed_m_s: float, vy_max_m_s: float) -> ArrivalStep:
        """Return the next velocity of a robot that moves sideways: straight there, and turning."""
        off = pose.inverse() @ goal
        distance = math.hypot(off.x_m, off.y_m)
        if self._phase is _Phase.STAND and not self._has_left(distance, off.theta_rad):
            return ArrivalStep(0.0, 0.0, True, False)
        self._phase = _Phase.DRIVE
        tolerance, most_rad = self._config.position_tolerance_m, self._config.heading_tolerance_rad
        v = vy = omega = 0.0
        if distance >= self._config.inside_share * tolerance:
            speed = max(
                self._speed(distance - 0.25 * tolerance, speed_m_s), self._config.arrival_m_s
            )
            v, vy = speed * off.x_m / distance, speed * off.y_m / distance
            excess = max(abs(vy) / vy_max_m_s, 1.0)
            v, vy = v / excess, vy / excess
        if abs(off.theta_rad) > self._config.inside_share * most_rad:
            omega = self._turn(off.theta_rad)
        if v == vy == omega == 0.0:
            self._phase = _Phase.STAND
        return ArrivalStep(v, omega, self._phase is _Phase.STAND, False, vy)

    def _has_left(self, distance_m: float, error_rad: float) -> bool:
        """Return whether something moved the robot away from where it had arrived."""
        config = self._config
        turned = self._phase is _Phase.STAND
        return distance_m > self._config.leaves_share * config.position_tolerance_m or (
            turned and abs(error_rad) > self._config.leaves_share * config.heading_tolerance_rad
        )

    def _is_there(self, off: SE2, distance_m: float) -> bool:
        """Return whether the position is reached, or was passed closely enough."""
        tolerance = self._config.position_tolerance_m
        beside = (
            abs(off.x_m) < 0.5 * self._config.inside_share * tolerance
            and distance_m < 0.9 * tolerance
        )
        return distance_m < self._config.inside_share * tolerance or beside

    def _drive(self, off: SE2, distance_m: float, speed_m_s: float) -> ArrivalStep:
        """Drive to the position, backwards where it lies behind."""
        gear = 1.0 if off.x_m >= 0.0 else -1.0
        bearing = math.atan2(gear * off.y_m, abs(off.x_m))
        if abs(bearing) > self._config.turn_first_rad:
            return ArrivalStep(0.0, self._turn(bearing), False, False)
        way = max(distance_m - 0.25 * self._config.position_tolerance_m, 0.0)
        v = gear * max(self._speed(way, speed_m_s), self._config.arrival_m_s)
        y = off.y_m if abs(off.y_m) > _BESIDE * self._config.position_tolerance_m else 0.0
        omega = 2.0 * abs(v) * gear * y / max(distance_m, 0.15) ** 2
        return ArrivalStep(v, min(max(omega, -self._omega_max), self._omega_max), False, False)

    def _speed(self, way_m: float, speed_m_s: float) -> float:
        """Return the speed from which half the sure deceleration stops in a way [m/s]."""
        return min(speed_m_s, math.sqrt(self._config.deceleration_m_s2 * way_m))

    def _turn(self, error_rad: float) -> float:
        """Return the rate that closes an error with half the angular deceleration [rad/s]."""
        size = abs(error_rad)
        rate = min(math.sqrt(self._alpha * size), 3.0 * size, self._omega_max)
        return math.copysign(max(rate, self._config.turn_min_rad_s), error_rad)

    def along(self, pose: SE2, track: Track, speed_m_s: float) -> ArrivalStep:
        """Stay on the path until the end of its section lies abeam; for robots that steer."""
        config, here = self._config, track.reference(pose)
        if self._phase is _Phase.STAND or here.way_m < 0.2 * config.position_tolerance_m:
            self._phase = _Phase.STAND
            off = pose.inverse() @ track.goal
            inside = math.hypot(off.x_m, off.y_m) <= config.position_tolerance_m
            arrived = inside and abs(off.theta_rad) <= config.heading_tolerance_rad
            return ArrivalStep(0.0, 0.0, arrived, not arrived)
        return self.keep_to(pose, track, speed_m_s)

    def keep_to(self, pose: SE2, track: Track, speed_m_s: float) -> ArrivalStep:
        """Stay on the path."""
        config, here = self._config, track.reference(pose)
        gear = -1.0 if track.section.reverse else 1.0
        if self._radius == 0.0 and abs(here.turned_rad) > _IN_LINE_RAD:
            return ArrivalStep(0.0, self._turn(-here.turned_rad), False, False)
        change = here.bend_per_m - gear * config.gain_per_m**2 * here.beside_m
        change -= 2.0 * config.gain_per_m * here.turned_rad
        most = 1.0 / self._radius if self._radius > 0.0 else self._omega_max / speed_m_s
        change = min(max(change, -most), most)
        v = self._speed(here.way_m, speed_m_s)
        if self._turn_over_s > 0.0:
            missing = self._not_steered(gear * change)
            v = min(v, self._bend_speed(track, here.turned_rad, missing))
        v = max(v, config.arrival_m_s)
        return ArrivalStep(gear * v, v * change, False, False)

    def _not_steered(self, curvature: float) -> float:
        """Return by how much the wheels will not be turned yet as they should be [1/m]."""
        most = self._config.dt_s / self._turn_over_s
        self._curvature = min(max(curvature, self._curvature - most), self._curvature + most)
        return abs(curvature - self._curvature)

    def _bend_speed(self, track: Track, turned_rad: float, missing: float) -> float:
        """Return the speed at which the wheels are turned in time for the bends to come [m/s]."""
        ways_m, changes = np.vstack([track.jumps(_PREVIEW_M), [[0.0, missing]]]).T
        changes = np.maximum(changes, 0.1)
        there = np.minimum(
            _LATE_M / (changes * self._turn_over_s), np.sqrt(self._alpha * _LATE_M / changes)
        )
        least = np.sqrt(there**2 + self._config.deceleration_m_s2 * ways_m).min()
        return float(least) if abs(turned_rad) < _ASTRAY_RAD else _SLOW_M_S
