"""How a simulated robot got there: its time, and how near it came to what stands around."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from firmware_sim.config.config import RobotConfig as SimulatedRobot
from firmware_sim.world.walking.walker import RADIUS_M
from firmware_sim.world.world import World
from robotctl.app.scoring.best_path import Best, best_path
from robotctl.app.scoring.outline import outline_distance
from robotctl.app.scoring.score import StampedPose
from robotctl.config.robot_file import RobotConfig
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.mission.mission_file import Mission

_LEFT_M: Final = 0.1
"""A robot this far from its start has set off [m]."""
_NEAR_MISS_M: Final = 0.05
_CLEAR_M: Final = 0.10
"""A near miss is over with this much room [m]."""
_NEARS_M_S: Final = 0.01
"""Closing speed of a robot that drives at a person [m/s]: standing, or being passed, is slower."""
_LOOK_M: Final = 2.0
"""Maximum distance from the body that is checked [m]."""


class JourneyScore:
    """Collects the true poses of a robot.

    Parameters
    ----------
    bodies
        Convex pieces of it in each of its states: (k, 2) corners of each in `base`,
        counter-clockwise [m].
    sides
        (n, 4) sides of all that stands in the world: x, y, x, y [m].
    best
        Finds the best path, once the run is over.

    Attributes
    ----------
    min_clearance_m
        Smallest distance of the outline from a side; 0 where it touched one, inf before a pose.
    near_misses
        Times that its own motion brought it nearer than 5 cm to something without touching; 10 cm
        away the next may begin.
    """

    def __init__(
        self,
        bodies: Sequence[Sequence[NDArray[np.float64]]],
        sides: NDArray[np.float64],
        best: Callable[[], Best | None] = lambda: None,
    ) -> None:
        self._bodies = [[np.ascontiguousarray(piece) for piece in body] for body in bodies]
        self._body = self._bodies[0]
        self._sides = np.ascontiguousarray(sides)
        self._best = best
        reaches_m = [float(np.hypot(*piece.T).max()) for body in self._bodies for piece in body]
        self._reach_m = max(reaches_m) + _LOOK_M
        self.min_clearance_m = math.inf
        self.near_misses = 0
        self._missing = False
        self._first: StampedPose | None = None
        self._last: StampedPose | None = None
        self._left_ns: int | None = None

    @property
    def time_s(self) -> float | None:
        """Time since the robot set off [s]; None if it never did."""
        if self._left_ns is None or self._last is None:
            return None
        return (self._last.stamp_ns - self._left_ns) * 1e-9

    def report(self, *, completed: bool) -> dict[str, Any]:
        """Return its part of the report of a run; `completed`: whether its mission is."""
        time_s, clearance_m, best = self.time_s, self.min_clearance_m, self._best()
        return {
            "time_s": None if time_s is None else round(time_s, 3),
            "best_m": None if best is None else round(best.length_m, 3),
            "best_s": None if best is None else round(best.time_s, 3),
            "time_by_best": round(time_s / best.time_s, 4)
            if completed and time_s and best
            else None,
            "min_clearance_m": round(clearance_m, 4) if math.isfinite(clearance_m) else None,
            "near_misses": self.near_misses,
        }

    def truth(
        self, pose: StampedPose, people_m: Sequence[tuple[float, float]] = (), body: int = 0
    ) -> None:
        """Take a true pose, where people are then, and the body's state, in order of the stamps."""
        self._body = self._bodies[body]
        self._first = self._first or pose
        before, self._last = self._last or pose, pose
        if self._left_ns is None and pose.distance_m(self._first) > _LEFT_M:
            self._left_ns = pose.stamp_ns
        clearance_m = self._clearance_m(pose, people_m)
        self.min_clearance_m = min(self.min_clearance_m, clearance_m)
        if not self._missing and 0.0 < clearance_m < _NEAR_MISS_M:
            nearer_m = self._clearance_m(before, people_m) - clearance_m
            since_s = (pose.stamp_ns - before.stamp_ns) * 1e-9
            self._missing = nearer_m > _NEARS_M_S * since_s
            self.near_misses += self._missing
        self._missing &= clearance_m < _CLEAR_M

    def _clearance_m(self, pose: StampedPose, people_m: Sequence[tuple[float, float]]) -> float:
        """Return the distance of the outline from the nearest thing or person [m]."""
        at = (pose.x_m, pose.y_m, pose.theta_rad)
        clearance_m = self._distance_m(self._sides, at)
        if people_m:
            apart_m = self._distance_m(np.hstack([people_m, people_m]), at) - RADIUS_M
            clearance_m = min(clearance_m, max(apart_m, 0.0))
        return clearance_m

    def _distance_m(self, sides: NDArray[np.float64], at: tuple[float, float, float]) -> float:
        """Return the distance of the body from the nearest side [m]."""
        return min(outline_distance(piece, sides, *at, self._reach_m) for piece in self._body)


def journey_score(
    simulated: SimulatedRobot, room: World, start: SE2, mission: Mission, robot: RobotConfig
) -> JourneyScore:
    """Return the score of a run that begins at `start`."""
    bodies = [[np.array(piece) for piece in pieces] for pieces in simulated.bodies]
    return JourneyScore(bodies, room.touchable, lambda: best_path(robot, room, start, mission))
