"""How a simulated robot got there: its time, and how near it came to what stands around."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from firmware_sim.world.people import RADIUS_M
from firmware_sim.world.world import World
from robotctl.app.simulation.best_path import Best, best_path
from robotctl.app.simulation.score import StampedPose
from robotctl.app.simulation.sim_options import SimOptions, simulated_robot
from robotctl.config.robot_file import RobotConfig
from robotctl.planning.behaviours.mission import Mission

_LEFT_M: Final = 0.1
"""A robot this far from its start has set off [m]."""
_NEAR_MISS_M: Final = 0.05
_CLEAR_M: Final = 0.10
"""A near miss is over with this much room [m]."""
_NEARS_M_S: Final = 0.01
"""A robot that stands, or is passed by somebody, does not come nearer as fast as this [m/s]."""
_LOOK_M: Final = 2.0
"""Farther away from the body nothing is looked at [m]."""


class JourneyScore:
    """Collects the true poses of a robot.

    Parameters
    ----------
    body
        (k, 2) corners of its outline in `base`, in order around it, convex [m].
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
        body: NDArray[np.float64],
        sides: NDArray[np.float64],
        best: Callable[[], Best | None] = lambda: None,
    ) -> None:
        self._body = body
        self._sides = sides
        self._best = best
        self._reach_m = float(np.hypot(*body.T).max()) + _LOOK_M
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

    def report(self) -> dict[str, Any]:
        """Return its part of the report of a run."""
        time_s, clearance_m, best = self.time_s, self.min_clearance_m, self._best()
        return {
            "time_s": None if time_s is None else round(time_s, 3),
            "best_m": None if best is None else round(best.length_m, 3),
            "best_s": None if best is None else round(best.time_s, 3),
            "min_clearance_m": round(clearance_m, 4) if math.isfinite(clearance_m) else None,
            "near_misses": self.near_misses,
        }

    def truth(self, pose: StampedPose, people_m: Sequence[tuple[float, float]] = ()) -> None:
        """Take a true pose, and where people are then; they come in the order of their stamps."""
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
        return min(self._from_sides_m(pose), self._from_people_m(pose, people_m))

    def _from_people_m(self, pose: StampedPose, people_m: Sequence[tuple[float, float]]) -> float:
        """Return the distance of the outline from the nearest person [m]; inf without people."""
        if not people_m:
            return math.inf
        c, s = math.cos(pose.theta_rad), math.sin(pose.theta_rad)
        middles = (np.array(people_m) - (pose.x_m, pose.y_m)) @ np.array([[c, -s], [s, c]])
        ends = np.repeat(middles[:, np.newaxis], 2, axis=1)
        return max(outline_distance(self._body, ends) - RADIUS_M, 0.0)

    def _from_sides_m(self, pose: StampedPose) -> float:
        """Return the distance of the outline from the nearest side [m]; inf if none is near."""
        c, s = math.cos(pose.theta_rad), math.sin(pose.theta_rad)
        ends = self._sides.reshape(-1, 2, 2) - (pose.x_m, pose.y_m)
        near = _from_origin(ends[:, 0], ends[:, 1]) < self._reach_m
        if not near.any():
            return math.inf
        ends = ends[near] @ np.array([[c, -s], [s, c]])
        return outline_distance(self._body, ends)


def journey_score(
    options: SimOptions, room: World, mission: Mission, robot: RobotConfig
) -> JourneyScore:
    """Return the score of a run.

    Raises
    ------
    SimulatorError
        If the robot's file is wrong.
    """
    body = np.array(simulated_robot(options.robot, options.overrides).simulation.body)
    x, y = body.T
    if (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() < 0.0:
        body = body[::-1]
    start = options.start_of(mission).pose
    return JourneyScore(body, room.touchable, lambda: best_path(robot, room, start, mission))


def outline_distance(body: NDArray[np.float64], ends: NDArray[np.float64]) -> float:
    """Return the distance of a convex outline (k, 2) from segments (n, 2, 2); 0 if they meet."""
    a, b = ends[:, 0], ends[:, 1]
    after = np.roll(body, -1, axis=0)
    if _meet(body, after, a, b):
        return 0.0
    corner = min(float(_from_origin(a - each, b - each).min()) for each in body)
    end = min(
        float(_from_origin(p - points, q - points).min())
        for p, q in zip(body, after, strict=True)
        for points in (a, b)
    )
    return min(corner, end)


def _meet(
    body: NDArray[np.float64],
    after: NDArray[np.float64],
    a: NDArray[np.float64],
    b: NDArray[np.float64],
) -> bool:
    """Return whether a part of a segment lies inside of the outline (Cyrus and Beck 1978)."""
    enters, leaves = np.zeros(len(a)), np.ones(len(a))
    outside = np.zeros(len(a), np.bool_)
    for p, q in zip(body, after, strict=True):
        inward = np.array([p[1] - q[1], q[0] - p[0]])  # of a counter-clockwise outline
        depth, change = (a - p) @ inward, (b - a) @ inward
        with np.errstate(divide="ignore", invalid="ignore"):
            at = -depth / change
        enters = np.where(change > 0.0, np.maximum(enters, at), enters)
        leaves = np.where(change < 0.0, np.minimum(leaves, at), leaves)
        outside |= (change == 0.0) & (depth < 0.0)
    return bool((~outside & (enters < leaves)).any())


def _from_origin(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance of the origin from segments whose ends are (n, 2)."""
    along = b - a
    squares = np.maximum((along**2).sum(axis=-1), 1e-18)
    share = np.clip(-(a * along).sum(axis=-1) / squares, 0.0, 1.0)
    distance: NDArray[np.float64] = np.hypot(*(a + share[..., np.newaxis] * along).T)
    return distance
