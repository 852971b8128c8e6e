"""Places at which a robot is out of the way of people who walk on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage  # type: ignore[import-untyped]

from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.journey.sidestep import sidestep
from robotctl.planning.behave.journey.tools import JourneyTools
from robotctl.planning.map.doors import RADIUS_M
from robotctl.planning.map.lane import Lane
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.path.global_planning.frontiers import connected
from robotctl.planning.path.global_planning.goal import Goal
from robotctl.planning.path.global_planning.plan import Plan, Point

TURN_RAD_S: Final = 1.0
"""Rate of a turn on the spot, in what a path takes [rad/s]."""
_FARTHEST_M: Final = 8.0
"""Maximum distance of a place aside [m]."""
_SEARCHED: Final = (2, 1.0)
_STEPPED: Final = (8, 0.4)
"""Maximum number of places that are tried in one search, and distance between them [m]: of those to
which a path is searched, and at walls."""
_GENTLENESS: Final = (2.2, 1.7, 1.3)
"""Ways of a step aside, as multiples of what the robot's circle allows: with the first of them its
nose hardly swings."""
_LEAST_M: Final = 0.3
"""Least way of a step aside [m]."""
_STEEP: Final = 3.0
"""Time that a metre less than that counts as, in times of driving it."""
_LATE: Final = 0.5
"""Share at which the time counts until the person is at a place aside."""
_ALONG_M: Final = np.arange(-_FARTHEST_M, _FARTHEST_M, 0.25)
_BESIDE_M: Final = np.arange(-1.0, 1.0, 0.02)
"""Places at a wall: along a lane from the robot on, and beside the lane [m]."""
_WALL_M: Final = 0.02
"""Clearance between a robot and the wall that it stands at [m]."""
SQUEEZE_M: Final = 0.03
"""Least clearance between a robot at a wall and a person who passes [m]."""
_TIGHT_S_PER_M: Final = 60.0
_STRAYS_S_PER_M: Final = 5.0
"""Time that a metre less of clearance counts as, and of what people may stray [s/m]."""
_IN_DOOR_S: Final = 10.0
"""Penalty of a place in a door [s]: people may want to get through."""


class _Places(NamedTuple):
    """Poses, and the time until the robot is there, with what speaks against each."""

    poses: NDArray[np.float64]
    """(n, 3) of `world` [m, m, rad]."""
    costs_s: NDArray[np.float64]


class _Search(NamedTuple):
    """Floor, people and robot that a place is searched for."""

    space: PlanningMap
    """The map around the robot."""
    wide: NDArray[np.bool_]
    """Cells of it that the robot gets to."""
    met: Lane
    """Lane of who comes along."""
    lanes: Sequence[Lane]
    """All lanes."""
    pose: SE2
    speed_m_s: float
    """Speed of the robot."""


class PlacesAside:
    """Finds places off the lanes of people, first the best.

    A robot stands off a lane wherever it can turn on the spot and its whole circle is beside it, or
    along a wall, parallel to the lane: that takes less floor, and leaves less room to people.

    Parameters
    ----------
    tools
        World, paths and settings.
    """

    def __init__(self, tools: JourneyTools) -> None:
        self._tools = tools
        self._config = tools.journey.people
        self._footprint = tools.world.body
        self._corners = np.array(self._footprint.points).reshape(-1, 2)
        self._radius_m = max(tools.paths.turning_radius_m, 2.0 * self._footprint.inscribed_m)

    def find(
        self,
        met: Lane,
        lanes: Sequence[Lane],
        pose: SE2,
        speed_m_s: float,
        failed: Sequence[Point],
    ) -> list[Goal]:
        """Return places off all lanes that the robot may reach in time, first the best.

        Parameters
        ----------
        met, lanes
            Lane of who comes along, and of all.
        pose, speed_m_s
            Where the robot is, and how fast it drives.
        failed
            Places that it could not get to.
        """
        space = self._tools.world.map.space_around(pose, _FARTHEST_M)
        wide = connected(space, space.clearance >= space.inscribed, (pose.x_m, pose.y_m))
        search = _Search(space, wide, met, lanes, pose, speed_m_s)
        open_, walls = self._open(search), self._at_walls(search)
        searched, stepped = _best(open_, failed, *_SEARCHED), _best(walls, failed, *_STEPPED)
        goals = [(cost_s, Goal(x_m, y_m)) for cost_s, x_m, y_m, _ in searched]
        goals += [(cost_s, Goal(*pose)) for cost_s, *pose in stepped]
        return [goal for _, goal in sorted(goals, key=lambda each: each[0])]

    def step_to(self, pose: SE2, there: SE2) -> Plan | None:
        """Return the most gentle path to a place at a wall that is free; None: there is none."""
        aside_m = abs((there.inverse() @ pose).y_m)
        for gentle in _GENTLENESS:
            length_m = max(gentle * math.sqrt(6.0 * self._radius_m * aside_m), _LEAST_M)
            plan = sidestep(pose, there, self._radius_m, length_m)
            if plan is not None and not self._tools.world.touches(plan.poses):
                return plan
        return None

    def _open(self, search: _Search) -> _Places:
        """Return the places where the robot can turn on the spot, and no lane comes near."""
        space, wide, met, lanes, pose, speed_m_s = search
        margin = self._tools.config.margin_m / space.grid.resolution_m
        floor = wide & (space.clearance >= space.circumscribed + margin)
        places = space.grid.centre_of(np.argwhere(floor))
        away_m = np.hypot(*(places - (pose.x_m, pose.y_m)).T)
        reach_m, config = self._footprint.reach_m, self._config
        for lane in lanes:
            ahead_m = lane.ahead_m(places)
            off_m = np.abs(lane.beside_m(places)) - lane.radius_m - reach_m
            clear = off_m >= config.pass_m + config.strays * np.maximum(ahead_m, 0.0)
            wide_m = reach_m + lane.radius_m  # on its last part the robot is off the lane
            early = (away_m - wide_m) / speed_m_s < (ahead_m - wide_m) / lane.speed_m_s
            keep = (clear & early) | (ahead_m < -wide_m)
            places, away_m = places[keep], away_m[keep]
        bearings = np.arctan2(places[:, 1] - pose.y_m, places[:, 0] - pose.x_m) - pose.theta_rad
        if self._tools.paths.steered:
            turns_s = self._shift_m(np.abs(away_m * np.sin(bearings))) / speed_m_s
        else:
            turns_s = np.arcsin(np.abs(np.sin(bearings))) / TURN_RAD_S
        costs_s = away_m / speed_m_s + turns_s - _LATE * met.ahead_m(places) / met.speed_m_s
        costs_s += self._doors_s(places)
        return _Places(np.column_stack([places, bearings]), costs_s)

    def _at_walls(self, search: _Search) -> _Places:
        """Return the places beside the lane of who is met, parallel to it, that leave room."""
        space, wide, met, lanes, pose, speed_m_s = search
        ahead, left = np.array([met.ahead_x, met.ahead_y]), np.array([-met.ahead_y, met.ahead_x])
        here = np.array([pose.x_m, pose.y_m])
        along_m, beside_m = (each.ravel() for each in np.meshgrid(_ALONG_M, _BESIDE_M))
        aside_m = np.abs(beside_m - met.beside_m(here))
        least_m = np.sqrt(6.0 * self._radius_m * aside_m)
        bends = np.abs(along_m) >= _GENTLENESS[-1] * least_m
        along_m, beside_m = along_m[bends], beside_m[bends]
        steep_m = np.maximum(_GENTLENESS[0] * least_m[bends] - np.abs(along_m), 0.0)
        places = np.outer(met.ahead_m(here) + along_m, ahead) + np.outer(beside_m, left)
        places += (met.x_m, met.y_m)
        heading_rad = met.heading_rad
        if abs(wrap_angle(heading_rad - pose.theta_rad)) > 0.5 * math.pi:
            heading_rad += math.pi
        poses = np.column_stack([places, np.full(len(places), heading_rad)])
        away_m = np.hypot(*(places - here).T)
        gaps_m = np.full(len(poses), math.inf)
        keep = np.ones(len(poses), np.bool_)
        for lane in lanes:
            near_m = lane.ahead_m(places) - self._footprint.reach_m - lane.radius_m
            gaps_m = np.minimum(gaps_m, lane.gaps_m(self._corners, poses, 0.0))
            keep &= (away_m / speed_m_s < near_m / lane.speed_m_s) | np.isinf(gaps_m)
        keep &= gaps_m >= SQUEEZE_M
        poses, gaps_m = poses[keep], gaps_m[keep]
        away_m = away_m[keep] + _STEEP * steep_m[keep]
        free = self._is_free(space, wide, poses, left)
        ahead_m, short_m = met.ahead_m(poses[:, :2]), self._config.pass_m - gaps_m
        strays_m = self._config.strays * np.maximum(ahead_m, 0.0)
        costs_s = away_m / speed_m_s - _LATE * ahead_m / met.speed_m_s
        costs_s += _TIGHT_S_PER_M * np.maximum(short_m, 0.0)
        costs_s += _STRAYS_S_PER_M * np.clip(short_m + strays_m, 0.0, strays_m)
        costs_s += self._doors_s(poses[:, :2])
        return _Places(poses[free], costs_s[free])

    def _doors_s(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the penalties of places (n, 2) that are in a door, (n,) [s]."""
        away_m = self._tools.world.doors.away_m(places)
        return np.where(away_m <= RADIUS_M + self._footprint.reach_m, _IN_DOOR_S, 0.0)

    def _shift_m(self, aside_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the way on which an arc to one side and one back shift the robot so far."""
        shifts_m: NDArray[np.float64] = 2.0 * np.sqrt(self._radius_m * aside_m)
        return shifts_m

    @staticmethod
    def _is_free(
        space: PlanningMap,
        wide: NDArray[np.bool_],
        poses: NDArray[np.float64],
        left: NDArray[np.float64],
    ) -> NDArray[np.bool_]:
        """Return where the robot has room at poses, and a little to both sides."""
        rows, columns = space.grid.cell_of(poses[:, :2]).T
        inside = (rows >= 0) & (rows < wide.shape[0]) & (columns >= 0) & (columns < wide.shape[1])
        free = np.zeros(len(poses), np.bool_)
        near = ndimage.binary_dilation(wide, iterations=2)
        free[inside] = near[rows[inside], columns[inside]]
        for side_m in (-_WALL_M, _WALL_M):
            moved = poses.copy()
            moved[:, :2] += side_m * left
            free &= ~space.collides(space.poses_to_cells(moved))
        return free


def _best(
    places: _Places, failed: Sequence[Point], most: int, apart_m: float
) -> list[tuple[float, float, float, float]]:
    """Return cost and pose of the best, apart from each other and from those that failed."""
    found: list[tuple[float, float, float, float]] = []
    for index in np.argsort(places.costs_s, kind="stable").tolist():
        x_m, y_m, heading_rad = places.poses[index].tolist()
        others = [*failed, *(each[1:3] for each in found)]
        if all(math.dist((x_m, y_m), other) >= apart_m for other in others):
            found.append((float(places.costs_s[index]), x_m, y_m, heading_rad))
            if len(found) == most:
                break
    return found
