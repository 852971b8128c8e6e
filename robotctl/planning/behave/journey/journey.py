"""The behaviour that drives to a goal: plans, follows, plans again, and recovers."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.behaviour import (
    Anchor,
    Behaviour,
    BehaviourInput,
    BehaviourOutput,
    done,
    failed,
)
from robotctl.planning.behave.behaviours.recovery import Ladder, Rung
from robotctl.planning.behave.journey.attempt import (
    BEHIND_M,
    TURN_RAD_S,
    TURNS_RAD,
    Attempt,
    poses_after,
)
from robotctl.planning.behave.journey.tools import JourneyTools
from robotctl.planning.path.global_planning.closed_way import ClosedWay
from robotctl.planning.path.global_planning.goal import Goal
from robotctl.planning.path.global_planning.plan import PlanFailure, Reason
from robotctl.planning.path.global_planning.route import Route
from robotctl.planning.path.local.controller import LocalMotion, LocalSituation
from robotctl.words import counted

_REPLAN_NS: Final = 1_000_000_000
"""Interval between two searches for a better path [ns]."""
_REDIRECTED_NS: Final = 500_000_000
"""Shortest time between two plans while the goal moves [ns]."""
_ELSEWHERE_M: Final = 0.5
"""Distance from which on a moved goal is another one for the ladder [m]."""
_BETTER: Final = 0.9
"""A path that costs less than this share of the present one replaces it."""
_OFF_PATH_M: Final = 0.6
"""Distance from the path beyond which the robot plans from where it is [m]."""
_STUCK_NS: Final = 1_500_000_000
"""A robot that wants to drive and stands for this long is in trouble [ns]."""
_PATIENT_NS: Final = 6_000_000_000
"""The same near a person, who is likely to move on [ns]."""
_AGAIN_NS: Final = 500_000_000
"""Interval between two searches for a path past a person who stands in the way [ns]."""
_STANDS_M_S: Final = 0.02
_STANDS_RAD_S: Final = 0.05
_LEFT_M: Final = 0.03
_LEFT_RAD: Final = 0.05
"""A robot that only sways where it came to stand, since the guard holds it, still stands."""
_PROGRESS_M: Final = 0.5
"""Distance driven that counts as progress [m]."""
_BLIND_NS: Final = 10_000_000_000
"""A robot that sees nothing for this long gives up [ns]."""
_CHORD_M: Final = 0.25
"""Length of path by which its direction is told [m]."""
_SOON_S: Final = 1.0
"""Time of a motion backwards that must be on known floor [s]; turns on the spot creep back."""
_TURNS_RAD_S: Final = 0.3
"""Rate from which on a turn has begun, and keeps its side [rad/s]."""
_PERMANENT_FAILURES: Final = frozenset(
    {
        Reason.GOAL_OFF_MAP,
        Reason.GOAL_BLOCKED,
        Reason.NO_PASSAGE,
        Reason.ONLY_THROUGH_UNKNOWN,
    }
)
"""Reasons that stay as long as the map is right; others may be those of the robot's own place."""


class _TurnRound(NamedTuple):
    """When a robot turns round on the spot before it drives along its path."""

    begin_rad: float
    """Heading error from which on it turns [rad]."""
    end_rad: float
    """Heading error at which it drives on [rad]."""
    rate_rad_s: float


_BACKWARDS: Final = _TurnRound(1.2, 0.15, TURN_RAD_S)
_AHEAD: Final = _TurnRound(2.85, 1.2, 1.2)


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

    Attributes
    ----------
    plans
        Paths taken, the first included.
    """

    def __init__(self, tools: JourneyTools, goal: Goal, speed_m_s: float) -> None:
        self._tools = tools
        self._goal = goal
        self._speed_m_s = speed_m_s
        self.plans = 0
        self._closed: _Closed | None = None
        self.reset()

    def anchor(self, pose: SE2) -> Anchor:
        """Return where the robot is: it plans from there."""
        return Anchor(pose.x_m, pose.y_m)

    def reset(self) -> None:
        """Start over."""
        self._ladder = Ladder(self._tools.recovery, can_turn=not self._tools.paths.steered)
        self._ladder_goal = self._goal
        """Goal that the tries of the ladder count for."""
        self._aim = self._goal
        """Goal that the path was planned to."""
        self.pause()

    def redirect(self, goal: Goal, speed_m_s: float) -> None:
        """Drive to another place from now on, along the present path until the next is planned."""
        self._goal, self._speed_m_s = goal, speed_m_s
        self._is_redirected = not self._is_near(self._aim, 0.5)
        self._chases = self._is_redirected or self._route is None
        if math.dist(goal[:2], self._ladder_goal[:2]) > _ELSEWHERE_M:
            self._ladder_goal = goal
            self._closed = None
            self._ladder.restart()

    def pause(self) -> None:
        """Replan after the pause."""
        self._route: Route | None = None
        self._is_redirected = False
        """Whether the goal has moved away from the end of the path."""
        self._chases = False
        """Whether it has moved since the last look for a path."""
        self._closed = None
        self._failure: PlanFailure | None = None
        """Why there is no path, found in a step that had no time to look farther."""
        self._planned_ns = 0
        self._planned_reverse = self._tools.paths.reverse
        self._turns_round = False
        self._attempt: Attempt | None = None
        self._stuck_ns: int | None = None
        self._stuck_at = SE2()
        self._blind_ns = 0
        self._driven_m = 0.0
        self._last: SE2 | None = None
        self._tools.controller.reset()

    @property
    def is_in_trouble(self) -> bool:
        """Whether it is on the ladder."""
        return self._attempt is not None

    @property
    def recoveries(self) -> int:
        """Tries to get on again."""
        return self._ladder.tries

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return the next velocity; done at the goal."""
        pose = situation.pose
        if blindness := self._tools.world.blindness:
            return self._wait_for_sight(blindness, now_ns)
        self._blind_ns = 0
        if self._route is None and self._is_near(_goal_of(pose), 1.0):
            return done()
        self._note_progress(pose)
        if (output := self._recover(situation, now_ns)) is not None:
            return output
        route = self._route_from(pose, now_ns)
        if isinstance(route, BehaviourOutput):
            return route
        if turn_rad_s := self._turning_round(situation, route):
            return BehaviourOutput(0.0, turn_rad_s, text="turning round")
        return self._drive(situation, route, now_ns)

    def _drive(self, situation: BehaviourInput, route: Route, now_ns: int) -> BehaviourOutput:
        """Return the next velocity along the path; done where it ends at the goal."""
        pose = situation.pose
        motion = self._looked_at(pose, self._follow(situation, route))
        self._tools.shown = route.rest, motion.ahead
        is_at_end = motion.arrived and not self._is_redirected
        if (is_at_end and route.leads_there) or self._is_there(pose):
            return done()
        if is_at_end and route.until:
            self._route = None
        if self._is_stuck(situation, motion, now_ns):
            return self._in_trouble(motion.text or "the way is blocked", pose, now_ns)
        text = motion.text or f"{route.left_m:.1f} m to go{route.until}"
        return BehaviourOutput(motion.v_m_s, motion.omega_rad_s, text=text, vy_m_s=motion.vy_m_s)

    def _wait_for_sight(self, blindness: str, now_ns: int) -> BehaviourOutput:
        """Stand while nothing is seen; give up after a while."""
        self._blind_ns = self._blind_ns or now_ns
        if now_ns - self._blind_ns > _BLIND_NS:
            return failed(f"{blindness} for {_BLIND_NS / 1e9:g} s")
        return BehaviourOutput(0.0, 0.0, text=f"waiting: {blindness}")

    def _note_progress(self, pose: SE2) -> None:
        """Count the way driven; enough of it, and the next trouble is a new one."""
        if self._last is not None and self._attempt is None:
            self._driven_m += math.dist((pose.x_m, pose.y_m), (self._last.x_m, self._last.y_m))
            if self._driven_m > _PROGRESS_M:
                self._ladder.progress()
        self._last = pose
        if self._closed is not None and _away_m(self._closed.pose, pose) > _PROGRESS_M:
            self._closed = None

    def _route_from(self, pose: SE2, now_ns: int) -> Route | BehaviourOutput:
        """Return the path to follow, or what to do where there is none."""
        if not self._looks_again(pose, now_ns) and self._route is not None:
            return self._route
        return self._find_route(pose, now_ns)

    def _looks_again(self, pose: SE2, now_ns: int) -> bool:
        """Return whether it is time to plan: there is no path, it is far away, or a while ago."""
        route = self._route
        turned_round = self._planned_reverse is not self._tools.paths.reverse
        if route is None or turned_round or route.advance(pose) > _OFF_PATH_M:
            self._route = None
            return True
        every_ns = _REDIRECTED_NS if self._is_redirected else _REPLAN_NS
        return now_ns - self._planned_ns >= every_ns

    def _plan(self, pose: SE2, now_ns: int) -> Route | PlanFailure:
        """Plan from here; keep the present path where it is free and hardly worse."""
        self._planned_ns, self._planned_reverse = now_ns, self._tools.paths.reverse
        chases, self._chases = self._chases, False
        if chases and (route := self._chase(pose)):
            return route
        leads_there = not self._tools.paths.is_far(pose, self._goal)
        old, answer = self._route, self._tools.paths.plan(pose, self._goal)
        if self._is_redirected or (old is not None and self._tools.world.touches(old.rest)):
            old = None
        if isinstance(answer, PlanFailure):
            return old or answer
        if old is not None and old.leads_there:
            is_better = answer.length_m <= _BETTER * old.left_m
            if not is_better or self._tools.paths.is_doubtful(answer, pose):
                return old
        self.plans += 1
        self._aim, self._is_redirected = self._goal, False
        leaves = self._tools.world.map.closed_at(pose)
        until = f" out of {leaves}" if leaves else ""
        return Route(answer, leads_there=leads_there and not leaves, until=until)

    def _chase(self, pose: SE2) -> Route | None:
        """Return the arc of a robot that steers to a goal that moves; None: it is to plan.

        Where the goal is too near beside it, it stays on its path: the goal will move on.
        """
        arc = self._tools.paths.arc_to(pose, self._goal)
        if arc is not None:
            self.plans += 1
            self._aim, self._is_redirected = self._goal, False
            return Route(arc)
        is_near = (
            math.dist((pose.x_m, pose.y_m), self._goal[:2]) < self._tools.paths.turning_radius_m
        )
        old = self._route
        if old is None or not is_near or self._tools.world.touches(old.rest):
            return None
        return old

    def _is_there(self, pose: SE2) -> bool:
        """Return whether the robot is at a goal where any heading will do."""
        return self._goal.heading_rad is None and self._is_near(_goal_of(pose), 1.0)

    def _is_near(self, place: Goal, share: float) -> bool:
        """Return whether a place is within a share of the tolerances of the goal."""
        config, wanted_rad = self._tools.config, self._goal.heading_rad
        if math.dist(place[:2], self._goal[:2]) > share * config.position_tolerance_m:
            return False
        if wanted_rad is None or place.heading_rad is None:
            return wanted_rad is None
        off_rad = wrap_angle(place.heading_rad - wanted_rad)
        return abs(off_rad) <= share * config.heading_tolerance_rad

    def _follow(self, situation: BehaviourInput, route: Route) -> LocalMotion:
        """Return the local controller's motion along the path."""
        tools, pose = self._tools, situation.pose
        return tools.controller.step(
            LocalSituation(
                pose,
                situation.twist,
                route.plan.poses,
                route.plan.reverse,
                tools.world.space_around(pose),
                tools.world.moving,
                min(self._speed_m_s, tools.world.speed_limit(pose, route.rest)),
            )
        )

    def _turning_round(self, situation: BehaviourInput, route: Route) -> float:
        """Return the turn of a robot that looks the wrong way [rad/s].

        Controllers look for better velocities near the present one, and straight away from the path
        neither turn is better. 0 where it need not turn, or has no room to.
        """
        pose, omega_rad_s = situation.pose, situation.twist.omega_rad_s
        back = route.rest[0, :2] - route.rest[:, :2]
        away = np.flatnonzero(np.hypot(*back.T) > _CHORD_M)
        if self._tools.paths.steered or not len(away):
            self._turns_round = False
            return 0.0
        law, wanted_rad = _AHEAD, float(route.rest[away[0], 2])
        if self._tools.paths.reverse:
            law, wanted_rad = _BACKWARDS, math.atan2(back[away[0], 1], back[away[0], 0])
        off_rad = wrap_angle(wanted_rad - pose.theta_rad)
        self._turns_round = abs(off_rad) > (law.end_rad if self._turns_round else law.begin_rad)
        if not self._turns_round:
            return 0.0
        side = math.copysign(1.0, off_rad)
        if abs(omega_rad_s) > _TURNS_RAD_S and not self._tools.paths.reverse:
            side = math.copysign(1.0, omega_rad_s)  # as the controller has begun
        swept = poses_after(pose, [SE2(0.0, 0.0, side * turn_rad) for turn_rad in TURNS_RAD])
        if self._tools.world.touches(swept):
            return 0.0
        return side * min(law.rate_rad_s, 2.0 * abs(off_rad))

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

    def _is_stuck(self, situation: BehaviourInput, motion: LocalMotion, now_ns: int) -> bool:
        """Return whether the robot has stood for too long though it is not there."""
        pose, twist = situation.pose, situation.twist
        stands = abs(twist.v_m_s) < _STANDS_M_S and abs(twist.omega_rad_s) < _STANDS_RAD_S
        if self._stuck_ns is None:
            if stands or motion.blocked:
                self._stuck_ns, self._stuck_at = now_ns, pose
            if motion.blocked:
                self._route = None  # perhaps another path leads there
        elif not motion.blocked and _has_left(self._stuck_at, pose):
            self._stuck_ns = None
        longest_ns = _PATIENT_NS if self._tools.world.is_somebody_near(pose) else _STUCK_NS
        return self._stuck_ns is not None and now_ns - self._stuck_ns > longest_ns

    def _find_route(self, pose: SE2, now_ns: int) -> Route | BehaviourOutput:
        """Return the path to follow from here on, or what to do where there is none."""
        if now_ns - self._planned_ns < _AGAIN_NS:
            if self._is_patient(pose, now_ns):
                return BehaviourOutput(0.0, 0.0, text="waiting for somebody to pass")
            if self._closed is not None and self._waits(self._closed, now_ns):
                return BehaviourOutput(0.0, 0.0, text=self._closed.text)
            if self._chases:
                return BehaviourOutput(0.0, 0.0, text="about to plan to where the goal is now")
        answer = self._failure or self._plan(pose, now_ns)
        if isinstance(answer, PlanFailure):
            found = self._without_path(answer, pose, now_ns)
            if isinstance(found, BehaviourOutput):
                return found
            answer = found
        if self._closed is not None:
            self._stuck_ns = None
        self._route = answer
        return answer

    def _without_path(
        self, failure: PlanFailure, pose: SE2, now_ns: int
    ) -> Route | BehaviourOutput:
        """Return the path to where the way is closed, or what to do where there is none."""
        if self._failure is None and not self._tools.paths.has_time:
            self._failure = failure
            return BehaviourOutput(0.0, 0.0, text=f"planning: {failure.text}")
        self._failure = None
        way = self._tools.paths.closed_way(pose, self._goal)
        if isinstance(way, PlanFailure) and way.reason in _PERMANENT_FAILURES:
            return failed(way.text)
        reason = way.text if isinstance(way, ClosedWay) else failure.text
        if isinstance(way, ClosedWay) and way.plan is not None:
            return Route(way.plan, leads_there=False, until=f" to where {reason}")
        if self._stuck_ns is None:
            self._stuck_ns, self._stuck_at = now_ns, pose
        if self._is_patient(pose, now_ns):
            return BehaviourOutput(0.0, 0.0, text=f"waiting for somebody: {reason}")
        if isinstance(way, ClosedWay):
            if self._closed is None:
                self._closed = _Closed(reason, now_ns, pose)
                self._ladder.tries += 1
            self._closed = self._closed._replace(text=f"{Rung.WAIT.value}: {reason}")
            if self._waits(self._closed, now_ns):
                return BehaviourOutput(0.0, 0.0, text=self._closed.text)
        return self._in_trouble(reason, pose, now_ns)

    def _waits(self, closed: _Closed, now_ns: int) -> bool:
        """Return whether it still waits for the way to open."""
        return now_ns - closed.since_ns < round(1e9 * self._tools.recovery.wait_s)

    def _is_patient(self, pose: SE2, now_ns: int) -> bool:
        """Return whether the robot, having waited for a person nearby, goes on waiting."""
        if self._stuck_ns is None or not self._tools.world.is_somebody_near(pose):
            return False
        return now_ns - self._stuck_ns <= _PATIENT_NS

    def _in_trouble(self, reason: str, pose: SE2, now_ns: int) -> BehaviourOutput:
        """Take the next rung of the ladder; fail where there is none."""
        rung = self._ladder.climb()
        self._route, self._stuck_ns, self._driven_m = None, None, 0.0
        if rung is None:
            return failed(f"gave up after {counted(self._ladder.tries, 'try', 'tries')}: {reason}")
        if rung is Rung.CLEAR:
            self._tools.world.forget_unseen()
        self._attempt = Attempt(rung, reason, now_ns, pose)
        return BehaviourOutput(0.0, 0.0, text=self._attempt.text)

    def _recover(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput | None:
        """Return the motion of the attempt under way; None: there is none, or it has ended."""
        attempt = self._attempt
        if attempt is None:
            return None
        output = attempt.step(self._tools, situation.pose, now_ns)
        if attempt.rung is Rung.WAIT and output is not None and self._may_go_on(situation, now_ns):
            output = None
        if output is None:
            self._attempt = None
        return output

    def _may_go_on(self, situation: BehaviourInput, now_ns: int) -> bool:
        """Return whether there is a path again, and the first step on it is free."""
        if now_ns - self._planned_ns < _AGAIN_NS:
            return False
        answer = self._plan(situation.pose, now_ns)
        if isinstance(answer, PlanFailure):
            return False
        self._route = answer
        motion = self._follow(situation, answer)
        self._tools.controller.reset()  # nothing has followed this step
        return not motion.blocked


DriveTo: TypeAlias = Callable[[Goal, float], Journey]
"""Makes the journey to a goal, at most at a speed [m/s]."""


class _Closed(NamedTuple):
    """A way that is closed, before which the robot waits."""

    text: str
    since_ns: int
    pose: SE2
    """Pose in which it waits."""


def _goal_of(pose: SE2) -> Goal:
    """Return a pose as a goal."""
    return Goal(pose.x_m, pose.y_m, pose.theta_rad)


def _away_m(place: SE2, pose: SE2) -> float:
    """Return how far two poses are apart [m]."""
    return math.dist((place.x_m, place.y_m), (pose.x_m, pose.y_m))


def _has_left(place: SE2, pose: SE2) -> bool:
    """Return whether a robot is elsewhere, or has turned."""
    return (
        _away_m(place, pose) > _LEFT_M
        or abs(wrap_angle(pose.theta_rad - place.theta_rad)) > _LEFT_RAD
    )
