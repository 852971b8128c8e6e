"""Waiting aside for people who come along the robot's path where they cannot be passed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.journey.places_aside import (
    SQUEEZE_M,
    TURN_RAD_S,
    PlacesAside,
)
from robotctl.planning.behave.journey.stuck_watch import distance_m
from robotctl.planning.behave.journey.tools import JourneyTools
from robotctl.planning.map.lane import Lane
from robotctl.planning.path.global_planning.goal import Goal
from robotctl.planning.path.global_planning.plan import Plan, PlanFailure, Point, joined
from robotctl.planning.path.global_planning.route import Route

_ALONG: Final = 0.7
"""Least cosine between the path and the direction of a person who walks along it."""
_SURE_STEPS: Final = 4
"""Steps in a row in which a meeting is expected: a track's first velocities are noisy."""
_AGAIN_NS: Final = 500_000_000
"""Interval between two searches for a place aside [ns]."""
_THERE_M: Final = 0.1
"""Length of the path aside that need not be driven [m]."""
_SPARE_S: Final = 0.5
"""Time between the robot leaving a lane and the person coming there [s]."""
_BLOCKED_NS: Final = 2_000_000_000
_STANDS_M: Final = 0.03
"""A robot that for so long [ns] comes no farther than this [m], nor turns, looks for another
place."""
_SLOWER: Final = 1.15
"""Time that a path takes, as a multiple of what it would at the speed that is wanted."""
_SLOW: Final = 0.8
_SLANTS: Final = (0.1, 0.45)
"""Share of its creeping speed that a robot steps aside with where it slants most, and slants from
and up to which it gets slower [sin]."""
_GEAR_S: Final = 1.0
"""Time of a change of gear [s]."""
_SAME_M: Final = 1.0
"""Distance within which something that moves is the one that was expected there [m]."""
_PASSED_M: Final = 0.5
"""Distance behind a person from which on the robot drives on [m]."""
_BESIDE_RAD: Final = 0.35
"""Angle between a path and a track's direction within which that person walks along it."""
_ASTRAY_NS: Final = 500_000_000
"""Time for which a person walks elsewhere than along the line before that counts [ns]."""
_OLD: Final = 0.8
"""Share at which an older measurement of where a person walks beside a line still counts."""
_UNSURE_M: Final = 0.05
"""Error of where a person walks [m]: less is no reason to leave a place."""
_CHORD_M: Final = 1.0
"""Distance to both sides over which the direction of a path is taken [m]."""
_KEPT: Final = 3
"""Step between the poses of its track that the robot drives back through: they are noisy."""
_BESIDE_M: Final = np.arange(-1.0, 1.01, 0.1)
"""Distances from the path at which the robot could pass a person [m]."""


class GiveWay:
    """Finds a place aside for a robot that is in a person's way, and the path there.

    A person who walks along the path, head-on or faster from behind, and whom the robot meets where
    there is no room to pass, is expected to walk straight on along it. Of the places off all lanes
    it takes a near one that it reaches before the person is there. Where there is none, the local
    controller does what it can.

    Parameters
    ----------
    tools
        World, paths and settings.
    """

    text: Final = "giving way to a person"

    def __init__(self, tools: JourneyTools) -> None:
        self._tools = tools
        self._config = tools.journey.people
        self._footprint = tools.world.body
        self._corners = np.array(self._footprint.points).reshape(-1, 2)
        self._places = PlacesAside(tools)
        self._not_before_ns = 0
        self.end()

    def end(self) -> None:
        """Forget the person."""
        self.route: Route | None = None
        """The path aside; None: it need not leave its own."""
        self._lane: Lane | None = None
        self._seen_ns = self._since_ns = self._moved_ns = self._straight_ns = 0
        self._moved = SE2()
        self._expected = 0
        self._stays = False
        """Whether it waits where it is, short of the place that it was driving to."""
        self._failed: list[Point] = []
        """Places that it could not get to."""
        self._track: Sequence[SE2] = ()

    def step(
        self,
        pose: SE2,
        route: Route | None,
        track: Sequence[SE2],
        speed_m_s: float,
        now_ns: int,
    ) -> Route | None:
        """Return the path aside; None: the robot may keep its own.

        Parameters
        ----------
        pose, route
            Where the robot is, and the path that it wants to drive.
        track
            Poses that it has driven ahead through, the last one first.
        speed_m_s
            Its speed.
        now_ns
            Time of the step.
        """
        self._track = track
        world = self._tools.world
        lanes = [Lane.of(each) for each in world.moving]
        lanes += [Lane.of(each, is_heard=True) for each in world.heard]
        if self._lane is not None:
            self._watch(self._lane, lanes, pose, now_ns)
        elif route is not None and now_ns >= self._not_before_ns and self._config.give_way_s > 0.0:
            self._begin(lanes, pose, route, speed_m_s, now_ns)
        return self.route

    @property
    def is_aside(self) -> bool:
        """Whether the robot is where it waits."""
        return self.route is not None and (self._stays or self.route.left_m < _THERE_M)

    def _watch(self, lane: Lane, lanes: list[Lane], pose: SE2, now_ns: int) -> None:
        """Follow the person, seen or not, until past the robot."""
        turned_rad = abs(wrap_angle(pose.theta_rad - self._moved.theta_rad))
        if self.is_aside or distance_m(pose, self._moved) + 0.1 * turned_rad > _STANDS_M:
            self._moved, self._moved_ns = pose, now_ns
        elif self.route is not None and now_ns - self._moved_ns > _BLOCKED_NS:
            self._stays = self._gap_m(lane, pose) >= SQUEEZE_M
            if not self._stays:
                self._give_up()
                return
        expected = lane.after((now_ns - self._seen_ns) * 1e-9)
        seen = min(lanes, key=lambda each: _apart_m(each, expected), default=expected)
        if seen is not expected and _apart_m(seen, expected) < _SAME_M:
            self._take(seen, lane, expected, pose, now_ns)
            if self._lane is None:
                return
            expected = self._lane.after((now_ns - self._seen_ns) * 1e-9)
        here = np.array([pose.x_m, pose.y_m])
        if float(expected.ahead_m(here)) < -self._footprint.reach_m - _PASSED_M:
            self.end()
        elif now_ns - self._since_ns > round(1e9 * self._config.give_way_s):
            self._not_before_ns = now_ns + round(1e9 * self._config.give_way_s)
            self.end()

    def _take(self, seen: Lane, lane: Lane, expected: Lane, pose: SE2, now_ns: int) -> None:
        """Take where the person is seen; forget one who walks elsewhere, or to the place aside."""
        if seen.is_heard:
            seen = seen.straightened(lane.heading_rad, math.pi).through(expected.x_m, expected.y_m)
        along = seen.ahead_x * lane.ahead_x + seen.ahead_y * lane.ahead_y
        if along > math.cos(_BESIDE_RAD):
            self._straight_ns = now_ns
        elif now_ns - self._straight_ns > _ASTRAY_NS:
            self.end()
            return
        if along > 0.0:
            seen = seen.straightened(lane.heading_rad, 0.5 * math.pi)
            expected = seen.aside(_OLD * float(expected.beside_m(np.array(seen[:2]))))
            self._lane, self._seen_ns = expected, now_ns
        if self._reaches_to(expected, pose):
            self._give_up()

    def _reaches_to(self, lane: Lane, pose: SE2) -> bool:
        """Return whether a person will touch a robot that waits where it means to."""
        there = pose if self._stays or self.route is None else SE2(*self.route.rest[-1].tolist())
        return self._gap_m(lane, there) < -_UNSURE_M

    def _gap_m(self, lane: Lane, pose: SE2) -> float:
        """Return how far a pose is off a lane [m]."""
        poses = np.array([[pose.x_m, pose.y_m, pose.theta_rad]])
        return float(lane.gaps_m(self._corners, poses, 0.0)[0])

    def _give_up(self) -> None:
        """Look for another place than the present one."""
        route, failed = self.route, self._failed
        self.end()
        if route is not None:
            x_m, y_m, _ = route.rest[-1].tolist()
            self._failed = [*failed, (x_m, y_m)]

    def _begin(
        self, lanes: list[Lane], pose: SE2, route: Route, speed_m_s: float, now_ns: int
    ) -> None:
        """Look for a place aside if a person comes along who cannot be passed."""
        for lane in lanes:
            near_m = lane.radius_m + self._footprint.reach_m
            place = meeting(lane, pose, route.rest, speed_m_s, near_m, self._config.ahead_s)
            if place is None:
                continue
            met = lane.straightened(place.theta_rad, _BESIDE_RAD)
            if met.is_heard:
                met = met.through(place.x_m, place.y_m)
            met_at = place, _after(place, route.rest)
            if met.is_heard or not all(self._has_room(met, each) for each in met_at):
                break
        else:
            self._expected = 0
            self._failed.clear()
            return
        self._expected += 1
        if self._expected < _SURE_STEPS:
            return
        self._not_before_ns = now_ns + _AGAIN_NS
        lanes = [met if each is lane else each for each in lanes]
        for goal in self._places.find(met, lanes, pose, speed_m_s, self._failed):
            plan = self._plan(pose, goal)
            steps = goal.heading_rad is not None
            if plan is not None and self._is_in_time(plan, pose, lanes, speed_m_s, steps=steps):
                self.route = Route(plan, leads_there=False)
                self._lane, self._moved = met, pose
                self._seen_ns = self._since_ns = self._moved_ns = self._straight_ns = now_ns
                return

    def _has_room(self, lane: Lane, place: SE2) -> bool:
        """Return whether the robot fits with its margin between a lane and what stands there."""
        margin_m = self._tools.config.margin_m
        beside, out = (
            np.array(
                [
                    (there.x_m, there.y_m, there.theta_rad)
                    for there in (place @ SE2(0.0, float(each_m), 0.0) for each_m in offs_m)
                ]
            )
            for offs_m in (_BESIDE_M, _BESIDE_M + margin_m * np.sign(_BESIDE_M))
        )
        clear = lane.gaps_m(self._corners, beside, 0.0) >= self._config.pass_m
        return bool(clear.any()) and not self._tools.world.map.collides(out[clear]).all()

    def _plan(self, pose: SE2, goal: Goal) -> Plan | None:
        """Return a path there; in reverse if that needs no turn on the spot."""
        paths = self._tools.paths
        if goal.heading_rad is not None:
            return self._places.step_to(pose, goal.seen_from(pose))
        if paths.steered:
            return self._plan_steered(pose, goal)
        kept, to = paths.reverse, goal.seen_from(pose)
        bearing_rad = math.atan2(to.y_m - pose.y_m, to.x_m - pose.x_m)
        paths.reverse = abs(wrap_angle(bearing_rad - pose.theta_rad)) > 0.5 * math.pi
        try:
            plan = paths.plan(pose, goal)
        finally:
            paths.reverse = kept
        return None if isinstance(plan, PlanFailure) else plan

    def _plan_steered(self, pose: SE2, goal: Goal) -> Plan | None:
        """Return a path without turning round, backwards on the robot's own track if it can."""
        back = _back_to(goal, pose, self._track, 2.0 * self._tools.paths.turning_radius_m)
        begin = pose if back is None else SE2(*back.poses[-1].tolist())
        plan = self._tools.paths.plan(begin, goal._replace(heading_rad=begin.theta_rad))
        if isinstance(plan, PlanFailure):
            return None
        return plan if back is None else joined([back, plan])

    def _is_in_time(
        self, plan: Plan, pose: SE2, lanes: list[Lane], speed_m_s: float, *, steps: bool
    ) -> bool:
        """Return whether the robot has left each place of a path before a person is there.

        Where it slants on a path that `steps` aside, a wall is near, and it is slow.
        """
        places = Route(plan).rest
        ways_m = np.hypot(*np.diff(places[:, :2], axis=0).T)
        slow_m_s = min(speed_m_s, _SLOW * self._tools.config.creep_m_s)
        slants = steps * np.abs(np.sin(places[1:, 2] - places[-1, 2]))
        speeds = np.interp(slants, _SLANTS, (speed_m_s, slow_m_s))
        times_s = np.concatenate([[0.0], np.cumsum(ways_m / speeds)]) * _SLOWER + _SPARE_S
        times_s += _GEAR_S * np.count_nonzero(np.diff(plan.reverse, prepend=False))
        if not self._tools.paths.steered:
            times_s += abs(wrap_angle(float(places[0, 2]) - pose.theta_rad)) / TURN_RAD_S
        for lane in lanes:
            inside = lane.gaps_m(self._corners, places, 0.0) < steps * _UNSURE_M
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

    Its heading is that of the path around there.

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
    at = int(np.argmax(meets))
    x_m, y_m, theta_rad = places[at].tolist()
    near = path[np.hypot(*(path[:, :2] - (x_m, y_m)).T) <= _CHORD_M]
    on_x, on_y = near[-1, :2] - near[0, :2]
    if math.hypot(on_x, on_y) >= _CHORD_M:
        theta_rad = math.atan2(on_y, on_x)
    return SE2(x_m, y_m, theta_rad)


def _after(place: SE2, path: NDArray[np.float64]) -> SE2:
    """Return the pose on a path a little after a place on it; the place if it ends before."""
    away_m = np.hypot(*(path[:, :2] - (place.x_m, place.y_m)).T)
    on = np.flatnonzero(away_m[int(np.argmin(away_m)) :] >= _CHORD_M)
    return SE2(*path[int(np.argmin(away_m)) + on[0]].tolist()) if len(on) else place


def _back_to(goal: Goal, pose: SE2, track: Sequence[SE2], room_m: float) -> Plan | None:
    """Return the way back on a robot's own track until a goal is so near, or None if it is ahead.

    Parameters
    ----------
    goal, pose
        Place to go to, and where the robot is.
    track
        Poses that it has driven ahead through, the last one first.
    room_m
        Distance from the goal from which a path leads there.
    """
    away_m = [math.dist((each.x_m, each.y_m), goal[:2]) for each in track]
    if len(track) < 2 or min(away_m) > 2.0 * room_m:
        return None
    there = next(i for i, each_m in enumerate(away_m) if each_m <= max(room_m, min(away_m)))
    if there < 2 * _KEPT:
        return None
    kept = [pose, *track[_KEPT:there:_KEPT]]
    poses = np.array([(each.x_m, each.y_m, each.theta_rad) for each in kept])
    reverse = np.ones(len(poses) - 1, np.bool_)
    length_m = float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum())
    return Plan(poses, length_m, 0, reverse)


def _apart_m(one: Lane, other: Lane) -> float:
    """Return how far those on two lanes are apart [m]."""
    return math.dist((one.x_m, one.y_m), (other.x_m, other.y_m))
