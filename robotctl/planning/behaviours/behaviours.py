"""Behaviours that move along paths, to points and to headings, and that wait."""

from __future__ import annotations

import math

from robotctl.model.drives.drives import Drive
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.guard.behaviour import (
    BehaviourInput,
    BehaviourOutput,
    Stopwatch,
    done,
    failed,
)
from robotctl.planning.guard.obstacle_guard import ObstacleGuard
from robotctl.planning.local.path import Path, Point
from robotctl.planning.local.pursuit import (
    Pursuit,
    PursuitConfig,
    bend_speed,
    heading_error_rad,
    in_base,
    miss_m,
    reachable_curvature,
    turn_rate,
)

_TURN_IN_CIRCLES = 1.5
"""A robot that joins its path has turned along it within so many turning circles of way."""

_REACH_AGAIN = 1.15
"""Backing up for a point out of reach goes on until it is reachable with this share to spare."""


class FollowPath:
    """Drives along a path from near its beginning to its end.

    After an interruption it goes on from where it was; `reset` begins at the start again.

    Parameters
    ----------
    path
        The path, in `world`.
    config, drive, speed_m_s, reverse
        As for `Pursuit`.
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
        self._pursuit = Pursuit(path, config, drive, speed_m_s, reverse=reverse)
        self._off_path_max = config.off_path_max_m
        self._circle_m = 2.0 * drive.min_turning_radius_m
        self._joined_s_m = -math.inf

    @property
    def anchor(self) -> Point:
        """Where on the path the robot is, or was left, in `world` [m]."""
        return self._path.point_at(self._pursuit.s_m)

    def join(self) -> None:
        """Go on from where it was left with any heading, which may take a turning circle."""
        self._joined_s_m = self._pursuit.s_m

    @property
    def s_m(self) -> float:
        """Length along the path up to where the robot is [m]."""
        return self._pursuit.s_m

    def resume(self, s_m: float) -> None:
        """Go on from a robot near the length `s_m` along the path [m], where it once was."""
        self._pursuit.reset(s_m)

    def reset(self) -> None:
        """Begin at the start of the path."""
        self._pursuit.reset()
        self._joined_s_m = -math.inf

    def pause(self) -> None:
        """Keep the progress along the path."""

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:  # noqa: ARG002 - as all behaviours
        """Return the next velocity; fails further off the path than allowed."""
        step = self._pursuit.step(situation.pose, situation.twist)
        joining = self._pursuit.s_m - self._joined_s_m <= _TURN_IN_CIRCLES * self._circle_m
        most_m = self._off_path_max + (self._circle_m if joining else 0.0)
        if step.off_path_m > most_m:
            return failed(f"{step.off_path_m:.2f} m off the path, {most_m:g} m are allowed")
        if step.done:
            return done()
        return BehaviourOutput(step.v_m_s, step.omega_rad_s, text=f"{step.remaining_m:.1f} m to go")


class GoTo:
    """Drives straight to a point: a differential drive turns to face it first (notes, 1.5).

    A drive-and-steer robot drives an arc. A point inside of its smallest turning circles is out
    of reach of any single arc: it backs up straight until the point is within reach. Nobody told
    it to, so it fails instead where no sonar looks back.

    Parameters
    ----------
    x_m, y_m
        The point in `world` [m].
    config, drive, speed_m_s
        As for `Pursuit`.
    guard
        Tells whether a sonar looks back.
    """

    def __init__(
        self,
        x_m: float,
        y_m: float,
        config: PursuitConfig,
        drive: Drive,
        speed_m_s: float,
        guard: ObstacleGuard,
    ) -> None:
        self._goal = (x_m, y_m)
        self._config = config
        self._radius = drive.min_turning_radius_m
        self._curvature_max = 1.0 / self._radius if self._radius > 0.0 else math.inf
        self._steered = drive.steered
        self._sees_back = guard.looks(-1.0)
        self._speed = speed_m_s
        self.reset()

    @property
    def anchor(self) -> Point:
        """The goal, in `world` [m]."""
        return self._goal

    def reset(self) -> None:
        """Start anew."""
        self._turning = False
        self._backing = False

    def pause(self) -> None:
        """Plan anew from wherever the robot is."""
        self.reset()

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:  # noqa: ARG002 - as all behaviours
        """Return the next velocity; done within the goal tolerance of the point."""
        config, pose = self._config, situation.pose
        x, y = self._goal
        distance = math.hypot(x - pose.x_m, y - pose.y_m)
        if distance <= config.goal_tolerance_m:
            return done()
        text = f"{distance:.1f} m to go"
        bearing = heading_error_rad(pose, x, y)
        v = min(self._speed, math.sqrt(2.0 * config.acceleration_m_s2 * distance))
        if self._steered and self._must_back(pose):
            if not self._sees_back:
                return failed(f"{text}, too close beside: no sonar looks back for backing up")
            return BehaviourOutput(-0.5 * self._speed, 0.0, text=f"{text}, backing up")
        if not self._steered and self._must_turn(bearing):
            return BehaviourOutput(0.0, turn_rate(bearing, config), text=f"{text}, turning")
        curvature = reachable_curvature(*in_base(pose, x, y), self._curvature_max)
        v = max(min(v, bend_speed(abs(curvature), config)), config.creep_m_s)
        return BehaviourOutput(v, curvature * v, text=text)

    def _must_back(self, pose: SE2) -> bool:
        """Say whether to back up; a point that full lock passes within tolerance is in reach."""
        x, y = self._goal
        if self._backing:
            miss = miss_m(pose, x, y, _REACH_AGAIN * self._radius)
            self._backing = miss > 0.0
        else:
            miss = miss_m(pose, x, y, self._radius)
            self._backing = miss > 0.8 * self._config.goal_tolerance_m
        return self._backing

    def _must_turn(self, bearing_rad: float) -> bool:
        """Say whether to turn on the spot; once begun, until the point is nearly ahead."""
        limit = self._config.turned_deg if self._turning else self._config.turn_on_spot_deg
        self._turning = abs(bearing_rad) > math.radians(limit)
        return self._turning


class TurnTo:
    """Turns on the spot to a heading of `world` [rad]. Only for a differential drive."""

    tolerance_rad = math.radians(2.0)

    def __init__(self, heading_rad: float, config: PursuitConfig) -> None:
        self._heading = heading_rad
        self._config = config

    def reset(self) -> None:
        """Start anew; there is nothing to forget."""

    def pause(self) -> None:
        """There is nothing to forget."""

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:  # noqa: ARG002 - as all behaviours
        """Return the next turn rate; done within 2 degrees and nearly at rest."""
        error = wrap_angle(self._heading - situation.pose.theta_rad)
        slow = abs(situation.twist.omega_rad_s) < 0.1
        if abs(error) <= self.tolerance_rad and slow:
            return done()
        return BehaviourOutput(
            0.0, turn_rate(error, self._config), text=f"{math.degrees(error):.0f} deg to turn"
        )


class Wait:
    """Stands still for a time [s]."""

    def __init__(self, duration_s: float) -> None:
        self._duration_ns = round(duration_s * 1e9)
        self.reset()

    def reset(self) -> None:
        """Begin to wait with the next step."""
        self._watch = Stopwatch()

    def pause(self) -> None:
        """Keep the time waited."""
        self._watch.pause()

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:  # noqa: ARG002 - as all behaviours
        """Return a stop; done when the time is over."""
        left_ns = self._duration_ns - self._watch.step(now_ns)
        return (
            done()
            if left_ns <= 0
            else BehaviourOutput(0.0, 0.0, text=f"{left_ns / 1e9:.0f} s to wait")
        )
