"""Waiting aside for people who come along the robot's path where they cannot be passed."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.journey.stuck_watch import distance_m
from robotctl.planning.behave.journey.tools import JourneyTools
from robotctl.planning.map.lane import Lane
from robotctl.planning.path.global_planning.frontiers import connected
from robotctl.planning.path.global_planning.goal import Goal
from robotctl.planning.path.global_planning.plan import Plan, PlanFailure, Point
from robotctl.planning.path.global_planning.route import Route

_ALONG: Final = 0.7
"""Least cosine between the path and the direction of a person who walks along it."""
_SURE_STEPS: Final = 4
"""Steps in a row in which a meeting is expected: a track's first velocities are noisy."""
_AGAIN_NS: Final = 500_000_000
"""Interval between two searches for a place aside [ns]."""
_PLANS: Final = 2
"""Maximum number of paths planned in one search."""
_APART_M: Final = 1.0
"""Distance between the places that they lead to [m]."""
_FARTHEST_M: Final = 8.0
"""Maximum distance of a place aside [m]."""
_THERE_M: Final = 0.1
"""Length of the path aside that need not be driven [m]."""
_LATE: Final = 0.5
"""Share at which the time counts until the person is at a place aside."""
_SPARE_S: Final = 0.5
"""Time between the robot leaving a lane and the person coming there [s]."""
_TURN_RAD_S: Final = 1.0
"""Rate of a turn on the spot, in what a path takes [rad/s]."""
_BLOCKED_NS: Final = 1_000_000_000
_STANDS_M: Final = 0.03
"""A robot that for so long [ns] comes no farther than this [m], nor turns, looks for another
place."""
_GEAR_S: Final = 1.0
"""Time of a change of gear [s]."""
_SAME_M: Final = 1.0
"""Distance within which something that moves is the one that was expected there [m]."""
_PASSED_M: Final = 0.5
"""Distance behind a person from which on the robot drives on [m]."""
_BESIDE_M: Final = np.arange(-1.0, 1.01, 0.1)
"""Distances from the path at which the robot could pass a person [m]."""


class GiveWay:
    """Finds a place aside for a robot that is in a person's way, and the path there.

    A person who walks along the path, head-on or faster from behind, and whom the robot meets where
    there is no room to pass, is expected to walk straight on. Of the places that the robot can
    stand at in any heading, off all lanes, it takes a near one that it reaches before the person is
    there. Where there is none, the local controller does what it can.

    Parameters
    ----------
    tools
        World, paths and settings.
    """

    text: Final = "giving way to a person"

    def __init__(self, tools: JourneyTools) -> None:
        self._tools = tools
        self._config = tools.journey.people
        self._footprint = tools.world.given.footprint
        self._corners = np.array(self._footprint.points).reshape(-1, 2)
        self._not_before_ns = 0
        self.end()

    def end(self) -> None:
        """Forget the person."""
        self.route: Route | None = None
        """The path aside; None: it need not leave its own."""
        self._lane: Lane | None = None
        self._seen_ns = self._since_ns = self._moved_ns = 0
        self._moved = SE2()
        self._expected = 0
        self._failed: list[Point] = []
        """Places that it could not get to."""

    def step(self, pose: SE2, route: Route | None, speed_m_s: float, now_ns: int) -> Route | None:
        """Return the path aside; None: the robot may keep its own.

        Parameters
        ----------
        pose, route
            Where the robot is, and the path that it wants to drive.
        speed_m_s
            Its speed.
        now_ns
            Time of the step.
        """
        lanes = [Lane.of(each) for each in self._tools.world.moving]
        if self._lane is not None:
            self._watch(self._lane, lanes, pose, now_ns)
        elif route is not None and now_ns >= self._not_before_ns and self._config.give_way_s > 0.0:
            self._begin(lanes, pose, route, speed_m_s, now_ns)
        return self.route

    @property
    def is_aside(self) -> bool:
        """Whether the robot is where it waits."""
        return self.route is not None and self.route.left_m < _THERE_M

    def _watch(self, lane: Lane, lanes: list[Lane], pose: SE2, now_ns: int) -> None:
        """Follow the person, seen or not, until past the robot."""
        turned_rad = abs(wrap_angle(pose.theta_rad - self._moved.theta_rad))
        if self.is_aside or distance_m(pose, self._moved) + 0.1 * turned_rad > _STANDS_M:
            self._moved, self._moved_ns = pose, now_ns
        elif self.route is not None and now_ns - self._moved_ns > _BLOCKED_NS:
            x_m, y_m, _ = self.route.rest[-1].tolist()
            self.end()
            self._failed.append((x_m, y_m))
            return
        expected = lane.after((now_ns - self._seen_ns) * 1e-9)
        seen = min(lanes, key=lambda each: _apart_m(each, expected), default=expected)
        if seen is not expected and _apart_m(seen, expected) < _SAME_M:
            self._lane, self._seen_ns, expected = seen, now_ns, seen
            if seen.ahead_x * lane.ahead_x + seen.ahead_y * lane.ahead_y < _ALONG:
                self.end()  # goes somewhere else
                return
        here = np.array([pose.x_m, pose.y_m])
        if float(expected.ahead_m(here)) < -self._footprint.reach_m - _PASSED_M:
            self.end()
        elif now_ns - self._since_ns > round(1e9 * self._config.give_way_s):
            self._not_before_ns = now_ns + round(1e9 * self._config.give_way_s)
            self.end()

    def _begin(
        self, lanes: list[Lane], pose: SE2, route: Route, speed_m_s: float, now_ns: int
    ) -> None:
        """Look for a place aside if a person comes along who cannot be passed."""
        for lane in lanes:
            near_m = lane.radius_m + self._footprint.reach_m
            place = meeting(lane, pose, route.rest, speed_m_s, near_m, self._config.ahead_s)
            if place is not None and not self._has_room(lane, place):
                break
        else:
            self._expected = 0
            self._failed.clear()
            return
        self._expected += 1
        if self._expected < _SURE_STEPS:
            return
        self._not_before_ns = now_ns + _AGAIN_NS
        for goal in self._places(lane, lanes, pose, speed_m_s):
            plan = self._plan(pose, goal)
            if plan is not None and self._is_in_time(plan, pose, lanes, speed_m_s):
                self.route = Route(plan, leads_there=False)
                self._lane, self._moved = lane, pose
                self._seen_ns = self._since_ns = self._moved_ns = now_ns
                return

    def _has_room(self, lane: Lane, place: SE2) -> bool:
        """Return whether the robot fits between a lane and what stands there."""
        poses = np.array(
            [
                (beside.x_m, beside.y_m, beside.theta_rad)
                for beside in (place @ SE2(0.0, float(each_m), 0.0) for each_m in _BESIDE_M)
            ]
        )
        clear = lane.gaps_m(self._corners, poses, 0.0) >= self._config.pass_m
        return bool(clear.any()) and not self._tools.world.map.collides(poses[clear]).all()

    def _places(self, met: Lane, lanes: list[Lane], pose: SE2, speed_m_s: float) -> list[Goal]:
        """Return places off all lanes; first those soon reached, and late by who is met."""
        space = self._tools.world.map.space_around(pose, _FARTHEST_M)
        side_m = space.grid.resolution_m
        wide = space.clearance >= space.inscribed
        roomy = space.clearance >= space.circumscribed + self._tools.config.margin_m / side_m
        floor = roomy & connected(space, wide, (pose.x_m, pose.y_m))
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
        goals: list[Goal] = []
        bearings = np.arctan2(places[:, 1] - pose.y_m, places[:, 0] - pose.x_m) - pose.theta_rad
        turns_s = np.arcsin(np.minimum(np.abs(np.sin(bearings)), 1.0)) / _TURN_RAD_S
        costs_s = away_m / speed_m_s + turns_s - _LATE * met.ahead_m(places) / met.speed_m_s
        for x_m, y_m in places[np.argsort(costs_s, kind="stable")].tolist():
            others = [*self._failed, *(goal[:2] for goal in goals)]
            if all(math.dist((x_m, y_m), other) >= _APART_M for other in others):
                goals.append(Goal(x_m, y_m))
                if len(goals) == _PLANS:
                    break
        return goals

    def _plan(self, pose: SE2, goal: Goal) -> Plan | None:
        """Return a path there; in reverse if that needs no turn on the spot."""
        paths = self._tools.paths
        kept, to = paths.reverse, goal.seen_from(pose)
        if paths.steered:  # it need not turn round
            goal = goal._replace(heading_rad=pose.theta_rad)
        else:
            paths.reverse = abs(wrap_angle(to.theta_rad - pose.theta_rad)) > 0.5 * math.pi
        try:
            plan = paths.plan(pose, goal)
        finally:
            paths.reverse = kept
        return None if isinstance(plan, PlanFailure) else plan

    def _is_in_time(self, plan: Plan, pose: SE2, lanes: list[Lane], speed_m_s: float) -> bool:
        """Return whether the robot has left each place of a path before a person is there."""
        places = Route(plan).rest
        ways_m = np.hypot(*np.diff(places[:, :2], axis=0).T)
        times_s = np.concatenate([[0.0], np.cumsum(ways_m)]) / speed_m_s + _SPARE_S
        times_s += _GEAR_S * np.count_nonzero(np.diff(plan.reverse))
        if not self._tools.paths.steered:
            times_s += abs(wrap_angle(float(places[0, 2]) - pose.theta_rad)) / _TURN_RAD_S
        for lane in lanes:
            inside = lane.gaps_m(self._corners, places, 0.0) < 0.0
            room_m = lane.ahead_m(places[:, :2]) - self._footprint.reach_m - lane.radius_m
            if (inside & (times_s * lane.speed_m_s > room_m)).any():
                return False
        return True


def meeting(
    lane: Lane,
    pose: SE2,
    path: NDArray[np.float64],
    speed_m_s: float,
    near_m: float,
    ahead_s: float,
) -> SE2 | None:
    """Return the pose on a path at which a robot meets a person who walks along it; None: none.

    Parameters
    ----------
    lane
        Of that person.
    pose, path
        Where the robot is, and what lies ahead of it, (n, 3) of `world`.
    speed_m_s
        Of the robot.
    near_m
        Distance between `base` and the middle of that person at which they meet [m].
    ahead_s
        Time ahead that counts.
    """
    ways_m = np.hypot(*np.diff(path[:, :2], axis=0).T)
    times_s = np.concatenate([[0.0], np.cumsum(ways_m)]) / speed_m_s
    times_s += math.dist((pose.x_m, pose.y_m), path[0, :2].tolist()) / speed_m_s
    soon = times_s <= ahead_s
    times_s, places = times_s[soon], path[soon]
    if not len(places) or lane.ahead_m(np.array([pose.x_m, pose.y_m])) < 0.0:
        return None
    there_m = lane.speed_m_s * times_s
    off_m = np.hypot(lane.ahead_m(places[:, :2]) - there_m, lane.beside_m(places[:, :2]))
    along = np.cos(places[:, 2]) * lane.ahead_x + np.sin(places[:, 2]) * lane.ahead_y
    meets = (off_m < near_m) & (np.abs(along) > _ALONG)
    if not meets.any():
        return None
    x_m, y_m, theta_rad = places[int(np.argmax(meets))].tolist()
    return SE2(x_m, y_m, theta_rad)


def _apart_m(one: Lane, other: Lane) -> float:
    """Return how far those on two lanes are apart [m]."""
    return math.dist((one.x_m, one.y_m), (other.x_m, other.y_m))
