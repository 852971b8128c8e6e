"""The behaviour that drives to a goal: plans, follows, plans again, and recovers."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.behaviour import (
    Anchor,
    Behaviour,
    BehaviourInput,
    BehaviourOutput,
    done,
    failed,
)
from robotctl.planning.behave.behaviours.recovery import Ladder
from robotctl.planning.behave.journey.blindness import BlindWait
from robotctl.planning.behave.journey.give_way import GiveWay
from robotctl.planning.behave.journey.progress import Progress
from robotctl.planning.behave.journey.replanner import Replanner
from robotctl.planning.behave.journey.rungs import (
    BEHIND_M,
    RUNGS,
    Rung,
    Trouble,
    Wait,
    poses_after,
)
from robotctl.planning.behave.journey.stuck_watch import StuckWatch, distance_m
from robotctl.planning.behave.journey.tools import JourneyTools
from robotctl.planning.behave.journey.turn_round import TurnRound
from robotctl.planning.braking import speed_before
from robotctl.planning.map.groups import with_groups
from robotctl.planning.path.global_planning.closed_way import ClosedWay
from robotctl.planning.path.global_planning.goal import Goal
from robotctl.planning.path.global_planning.plan import PlanFailure, Point, Reason
from robotctl.planning.path.global_planning.route import Route
from robotctl.planning.path.local.controller import LocalMotion, LocalSituation
from robotctl.words import counted

_ELSEWHERE_M: Final = 0.5
"""Distance from which on a moved goal is another one for the ladder [m]."""
_AGAIN_NS: Final = 500_000_000
"""Interval between two searches for a path past a person who stands in the way [ns]."""
_OFTEN: Final = 3
_SAME_M: Final = 0.5
"""Number of troubles within a distance [m] from which on the robot avoids a place."""
_LONGER: Final = 1.5
_MORE_M: Final = 2.0
"""Factor and length [m] by which a detour exceeds the rest of the path before it."""
_AHEAD_M: Final = 0.6
"""Distance to the place that the robot counts as closed where it stands in trouble [m]."""
_SOON_S: Final = 1.0
"""Time of a motion backwards that must be on known floor [s]; turns on the spot creep back."""
_SCAN_S: Final = 0.1
"""Age of what a lidar shows [s]."""
_LATELY_NS: Final = 10_000_000_000
"""Time for which a person who was near may still be in the way [ns]."""
_JUST_NS: Final = 2_000_000_000
"""Time for which a person who was near may be about to pass [ns]."""
_LOOKS_M_S: Final = 0.1
"""Speed at which the robot may come to see more, however little it sees [m/s]."""
_STEP_BACK: Final = "waiting for somebody to step back"
_WAITS_BEFORE: Final = BehaviourOutput(0.0, 0.0, text="waiting before a detour")
_PERMANENT_FAILURES: Final = frozenset(
    {
        Reason.GOAL_OFF_MAP,
        Reason.GOAL_BLOCKED,
        Reason.NO_PASSAGE,
        Reason.ONLY_THROUGH_UNKNOWN,
    }
)
"""Reasons that stay as long as the map is right; others may be those of the robot's own place."""


class Journey(Behaviour):
    """Drives to a goal.

    It plans, lets the local controller follow the path round what stands in the way, looks once a
    second for a better one, and plans at once where the path is blocked. Where something that no
    map shows closes every way, it drives up to there and waits. In trouble it climbs the ladder of
    `recovery`, and fails with the last reason where that ends.

    Parameters
    ----------
    tools
        World, paths and controller.
    goal, speed_m_s
        Where to, and the largest speed [m/s].
    """

    def __init__(self, tools: JourneyTools, goal: Goal, speed_m_s: float) -> None:
        self._tools = tools
        self._speed_m_s = speed_m_s
        self._replanner = Replanner(tools, goal)
        self._turn_round = TurnRound(tools)
        self._stuck = StuckWatch(tools.world, tools.journey)
        self._blind = BlindWait(tools.journey.blind_max_s)
        self._progress = Progress()
        self._rung: Rung | None = None
        self._closed: _Closed | None = None
        self.reset()

    @property
    def plans(self) -> int:
        """Paths taken, the first included."""
        return self._replanner.plans

    def anchor(self, pose: SE2) -> Anchor:
        """Return where the robot is: it plans from there."""
        return Anchor(pose.x_m, pose.y_m)

    def reset(self) -> None:
        """Start over."""
        self._ladder = Ladder(self._tools.recovery, can_turn=not self._tools.paths.steered)
        self._ladder_goal = self._replanner.goal
        """Goal that the tries of the ladder count for."""
        self._met_ns: int | None = None
        """Last time at which a person was near [ns]."""
        self._given_up_ns: int | None = None
        """Time of the first end of the ladder since the last progress [ns]."""
        self._replanner.reset()
        self._begin_journey()
        self.pause()

    def redirect(self, goal: Goal, speed_m_s: float) -> None:
        """Drive to another place from now on, along the present path until the next is planned."""
        self._speed_m_s = speed_m_s
        self._replanner.redirect(goal)
        if math.dist(goal[:2], self._ladder_goal[:2]) > _ELSEWHERE_M:
            self._ladder_goal = goal
            self._closed = self._given_up_ns = None
            self._ladder.restart()
            self._begin_journey()

    def _begin_journey(self) -> None:
        """Forget the troubles of the last journey, and the length of its path."""
        self._troubles: list[Point] = []
        """Places of troubles so far, with nobody near [m]."""
        self._left_m = math.inf
        """Remaining length of the path that was followed last [m]."""
        self._detour: _Detour | None = None
        """Detour before which the robot waits; None: there is none."""
        self._tools.paths.begin_journey()

    def pause(self) -> None:
        """Replan after the pause; what the robot has asked counts as answered by it."""
        if self._rung is not None and self._rung.asks:
            self._ladder.restart()
        self._replanner.pause()
        self._turn_round.reset()
        self._stuck.reset()
        self._blind.end()
        self._give_way = GiveWay(self._tools)
        self._closed = None
        self._failure: PlanFailure | None = None
        """Why there is no path, found in a step that had no time to look farther."""
        self._rung = None
        self._progress.pause()
        self._tools.controller.reset()

    @property
    def is_in_trouble(self) -> bool:
        """Whether it is on the ladder."""
        return self._rung is not None

    @property
    def recoveries(self) -> int:
        """Tries to get on again."""
        return self._ladder.tries

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return the next velocity; done at the goal."""
        pose = situation.pose
        if blindness := self._tools.world.blindness:
            return self._blind.step(blindness, now_ns)
        self._blind.end()
        if self._replanner.route is None and self._replanner.stands_there(pose):
            return done()
        self._note_progress(pose)
        if self._tools.world.is_somebody_near(pose):
            self._met_ns = now_ns
        if (output := self._step_aside(situation, now_ns)) is not None:
            return output
        if (output := self._recover(situation, now_ns)) is not None:
            return output
        route = self._route_from(pose, now_ns)
        if isinstance(route, BehaviourOutput):
            return route
        if turn_rad_s := self._turn_round.step(situation, route):
            return BehaviourOutput(0.0, turn_rad_s, text="turning round")
        return self._drive(situation, route, now_ns)

    def _drive(self, situation: BehaviourInput, route: Route, now_ns: int) -> BehaviourOutput:
        """Return the next velocity along the path; done where it ends at the goal."""
        pose = situation.pose
        motion = self._looked_at(pose, self._follow(situation, route))
        if motion.creeps and self._met_lately(now_ns, _JUST_NS):
            # Creeping would push a person who touches it; people step back by themselves.
            motion = motion._replace(
                v_m_s=0.0, omega_rad_s=0.0, vy_m_s=0.0, blocked=True, text=_STEP_BACK
            )
        self._left_m = route.left_m
        self._tools.shown = route.rest, motion.ahead
        is_at_end = motion.arrived and not self._replanner.is_redirected
        if (is_at_end and route.leads_there) or self._replanner.is_there(pose):
            return done()
        if is_at_end and route.until:
            self._replanner.route = None
        if motion.blocked and not self._stuck.stands:
            self._replanner.route = None  # perhaps another path leads there
        if self._stuck.step(situation, motion, now_ns):
            return self._in_trouble(motion.text or "the way is blocked", pose, now_ns)
        text = motion.text or f"{route.left_m:.1f} m to go{route.until}"
        return BehaviourOutput(motion.v_m_s, motion.omega_rad_s, text=text, vy_m_s=motion.vy_m_s)

    def _step_aside(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput | None:
        """Return the motion while it gives way, aside or at rest there; None: nobody comes."""
        gave_way = self._give_way.route is not None
        wanted = None if self._rung is not None else self._replanner.route
        track = self._progress.track
        route = self._give_way.step(situation.pose, wanted, track, self._speed_m_s, now_ns)
        if route is None:
            if gave_way:
                self._replanner.route = None
                self._stuck.reset()
            return None
        self._stuck.reset()
        route.advance(situation.pose)
        if self._give_way.is_aside:
            return BehaviourOutput(0.0, 0.0, text=GiveWay.text)
        motion = self._looked_at(situation.pose, self._follow(situation, route))
        self._tools.shown = route.rest, motion.ahead
        return BehaviourOutput(
            motion.v_m_s, motion.omega_rad_s, text=GiveWay.text, vy_m_s=motion.vy_m_s
        )

    def _note_progress(self, pose: SE2) -> None:
        """Count the way driven; enough of it, and the next trouble is a new one."""
        if self._rung is None:
            self._progress.follow(pose)
            if self._progress.driven_m > self._tools.journey.rungs.progress_m:
                self._ladder.progress()
                self._given_up_ns = self._detour = None
        else:
            self._progress.stand(pose)
        if (
            self._closed is not None
            and distance_m(self._closed.pose, pose) > self._tools.journey.rungs.progress_m
        ):
            self._closed = None

    def _route_from(self, pose: SE2, now_ns: int) -> Route | BehaviourOutput:
        """Return the path to follow, or what to do where there is none."""
        route = self._replanner.route
        if not self._replanner.is_due(pose, now_ns) and route is not None:
            return route
        return self._find_route(pose, now_ns)

    def _follow(self, situation: BehaviourInput, route: Route) -> LocalMotion:
        """Return the local controller's motion along the path."""
        tools, pose = self._tools, situation.pose
        motion = tools.controller.step(
            LocalSituation(
                pose,
                situation.twist,
                route.plan.poses,
                route.plan.reverse,
                tools.world.space_around(pose),
                self._moving(pose),
                self._speed_on(route, pose),
                tools.pace.effort,
            )
        )
        tools.pace.lap("steer")
        return motion

    def _moving(self, pose: SE2) -> NDArray[np.float64]:
        """Return what moves, groups included, as `LocalSituation.moving`."""
        world, group_m = self._tools.world, self._tools.journey.people.group_m
        return with_groups(world.moving, group_m, (pose.x_m, pose.y_m), world.body.reach_m)

    def _speed_on(self, route: Route, pose: SE2) -> float:
        """Return the largest speed here [m/s]: that of zones, and of what may come into sight."""
        tools, config = self._tools, self._tools.config
        limit_m_s = min(self._speed_m_s, tools.world.speed_limit(pose, route.rest))
        walks_m_s = tools.journey.people.hidden_m_s
        if walks_m_s == 0.0:
            return limit_m_s
        sees_m_s = speed_before(
            tools.world.sight_m(route.rest),
            walks_m_s,
            config.deceleration_m_s2,
            config.reaction_s + _SCAN_S,
        )
        return min(limit_m_s, max(sees_m_s, _LOOKS_M_S))

    def _looked_at(self, pose: SE2, motion: LocalMotion) -> LocalMotion:
        """Return a motion; none backwards where nothing has seen yet what is there."""
        if motion.v_m_s >= 0.0:
            return motion
        times_s = [min(-x_m / motion.v_m_s, _SOON_S) for x_m in BEHIND_M]
        behind = poses_after(
            pose, [SE2.exp(motion.v_m_s * t, 0.0, motion.omega_rad_s * t) for t in times_s]
        )
        if self._tools.world.map.is_known(behind):
            return motion
        text = "no sensor has seen what is behind"
        return motion._replace(v_m_s=0.0, omega_rad_s=0.0, blocked=True, text=text)

    def _find_route(self, pose: SE2, now_ns: int) -> Route | BehaviourOutput:
        """Return the path to follow from here on, or what to do where there is none."""
        if now_ns - self._replanner.planned_ns < _AGAIN_NS:
            if self._stuck.is_patient(pose, now_ns):
                return BehaviourOutput(0.0, 0.0, text="waiting for somebody to pass")
            if self._detour is not None:
                return _WAITS_BEFORE
            if self._closed is not None and self._waits(self._closed, now_ns):
                return BehaviourOutput(0.0, 0.0, text=self._closed.text)
            if self._replanner.chases:
                return BehaviourOutput(0.0, 0.0, text="about to plan to where the goal is now")
        answer = self._failure or self._replanner.plan(pose, now_ns)
        if isinstance(answer, PlanFailure):
            found = self._without_path(answer, pose, now_ns)
            if isinstance(found, BehaviourOutput):
                return found
            answer = found
        if self._waits_before(answer, pose, now_ns):
            self._replanner.route = None
            return _WAITS_BEFORE
        if self._closed is not None:
            self._stuck.reset()
        self._replanner.route = answer
        return answer

    def _waits_before(self, answer: Route, pose: SE2, now_ns: int) -> bool:
        """Return whether a path is a detour, and people near may yet clear the way.

        After a while the robot takes the detour, and avoids the place that was closed from then
        on: it does not come back each time somebody there moves a little.
        """
        is_detour = answer.left_m > _LONGER * self._left_m + _MORE_M
        sees = self._tools.world.sees_by_lidar
        if not (is_detour and sees and self._met_lately(now_ns, _JUST_NS)):
            self._detour = None
            return False
        if self._detour is None:
            self._detour = _Detour(now_ns, self._place_closed(pose))
        if now_ns - self._detour.since_ns <= round(1e9 * self._tools.journey.patience_s):
            return True
        self._tools.paths.avoid(self._detour.closed)
        self._detour = None
        return False

    def _place_closed(self, pose: SE2) -> Point:
        """Return where the present path is closed; a little ahead if it seems to be free."""
        route = self._replanner.route
        if route is not None:
            hits = self._tools.world.map.collides(route.rest)
            if hits.any():
                x_m, y_m, _ = route.rest[int(np.argmax(hits))].tolist()
                return x_m, y_m
        return self._place_ahead(pose)

    def _without_path(
        self, failure: PlanFailure, pose: SE2, now_ns: int
    ) -> Route | BehaviourOutput:
        """Return the path to where the way is closed, or what to do where there is none."""
        if self._failure is None and not self._tools.paths.has_time:
            self._failure = failure
            return BehaviourOutput(0.0, 0.0, text=f"planning: {failure.text}")
        self._failure = None
        way = self._tools.paths.closed_way(pose, self._replanner.goal)
        if isinstance(way, PlanFailure) and way.reason in _PERMANENT_FAILURES:
            return failed(way.text)
        reason = way.text if isinstance(way, ClosedWay) else failure.text
        if isinstance(way, ClosedWay) and way.plan is not None:
            return Route(way.plan, leads_there=False, until=f" to where {reason}")
        self._stuck.begin(pose, now_ns)
        if self._stuck.is_patient(pose, now_ns):
            return BehaviourOutput(0.0, 0.0, text=f"waiting for somebody: {reason}")
        if isinstance(way, ClosedWay):
            if self._closed is None:
                self._closed = _Closed(reason, now_ns, pose)
                self._ladder.tries += 1
            self._closed = self._closed._replace(text=f"{Wait.words}: {reason}")
            if self._waits(self._closed, now_ns):
                return BehaviourOutput(0.0, 0.0, text=self._closed.text)
        return self._in_trouble(reason, pose, now_ns)

    def _waits(self, closed: _Closed, now_ns: int) -> bool:
        """Return whether it still waits for the way to open."""
        return now_ns - closed.since_ns < round(1e9 * self._tools.recovery.wait_s)

    def _in_trouble(self, reason: str, pose: SE2, now_ns: int) -> BehaviourOutput:
        """Take the next rung of the ladder; fail where there is none."""
        name = self._ladder.climb()
        if name is None and self._waits_for_people(now_ns):
            self._ladder.restart()
            name = self._ladder.climb()
        place = self._place_ahead(pose)
        if not self._met_lately(now_ns, _LATELY_NS):  # else people may have been the trouble
            self._troubles.append(place)
            if sum(math.dist(place, each) < _SAME_M for each in self._troubles) >= _OFTEN:
                self._tools.paths.avoid(place)
                self._turn_round.face_path()
        trouble = Trouble(reason, now_ns, pose, place, self._progress.track)
        self._replanner.route, self._progress.driven_m = None, 0.0
        self._stuck.reset()
        if name is None:
            return failed(f"gave up after {counted(self._ladder.tries, 'try', 'tries')}: {reason}")
        self._rung = RUNGS[name](trouble, self._tools)
        return BehaviourOutput(0.0, 0.0, text=self._rung.text, asks=self._rung.asks)

    def _waits_for_people(self, now_ns: int) -> bool:
        """Return whether people may be holding up the robot, and it still has patience."""
        if not self._met_lately(now_ns, _LATELY_NS):
            return False
        if self._given_up_ns is None:
            self._given_up_ns = now_ns
        return now_ns - self._given_up_ns < round(1e9 * self._tools.recovery.people_s)

    def _met_lately(self, now_ns: int, within_ns: int) -> bool:
        """Return whether a person has been near within a time [ns]."""
        return self._met_ns is not None and now_ns - self._met_ns <= within_ns

    def _place_ahead(self, pose: SE2) -> Point:
        """Return where the robot does not get on: a little ahead, on its path if it has one."""
        away = pose @ SE2(_AHEAD_M)
        route = self._replanner.route
        if route is not None and len(route.rest):
            off_m = np.hypot(*(route.rest[:, :2] - (pose.x_m, pose.y_m)).T)
            x_m, y_m = route.rest[int(np.argmax(off_m >= min(_AHEAD_M, off_m.max()))), :2].tolist()
            return x_m, y_m
        return away.x_m, away.y_m

    def _recover(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput | None:
        """Return the motion of the rung under way; None: there is none, or it has ended."""
        rung = self._rung
        if rung is None:
            return None
        output = rung.step(situation, now_ns)
        if rung.asks and situation.go_ahead:
            self._ladder.restart()
            self._closed = output = None
        elif rung.watches and output is not None and self._may_go_on(situation, now_ns):
            output = None
        if output is None:
            self._rung = None
            if rung.turns_first:
                self._turn_round.face_path()
        return output

    def _may_go_on(self, situation: BehaviourInput, now_ns: int) -> bool:
        """Return whether there is a path again, and the first step on it is free."""
        if now_ns - self._replanner.planned_ns < _AGAIN_NS:
            return False
        answer = self._replanner.plan(situation.pose, now_ns)
        if isinstance(answer, PlanFailure):
            return False
        self._replanner.route = answer
        motion = self._follow(situation, answer)
        self._tools.controller.reset()  # nothing has followed this step
        return not motion.blocked


DriveTo: TypeAlias = Callable[[Goal, float], Journey]
"""Makes the journey to a goal, at most at a speed [m/s]."""


class _Detour(NamedTuple):
    """A detour before which the robot waits."""

    since_ns: int
    """Time since which it waits [ns]."""
    closed: Point
    """Place at which the shorter way is closed [m]."""


class _Closed(NamedTuple):
    """A way that is closed, before which the robot waits."""

    text: str
    since_ns: int
    pose: SE2
    """Pose in which it waits."""
