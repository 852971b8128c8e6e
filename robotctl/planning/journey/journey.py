"""The behaviour that drives to a goal: plans, follows, plans again, and recovers."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behaviours.kind import Goal
from robotctl.planning.global_planning.plan import Plan, PlanFailure
from robotctl.planning.guard.behaviour import (
    Anchor,
    Behaviour,
    BehaviourInput,
    BehaviourOutput,
    done,
    failed,
)
from robotctl.planning.journey.recovery import Ladder, Rung
from robotctl.planning.journey.route import Route
from robotctl.planning.local.controller import LocalMotion, LocalSituation
from robotctl.words import counted

if TYPE_CHECKING:
    from robotctl.planning.journey.pilot import MapPilot

_REPLAN_NS: Final = 1_000_000_000
"""Between two looks for a better path [ns]."""
_BETTER: Final = 0.9
"""A path that costs less than this share of the present one replaces it."""
_OFF_PATH_M: Final = 0.6
"""Farther off, the robot plans from where it is [m]."""
_STUCK_NS: Final = 1_500_000_000
"""A robot that wants to drive and stands for this long is in trouble [ns]."""
_PATIENT_NS: Final = 6_000_000_000
"""The same where somebody is near, who is likely to go on [ns]."""
_AGAIN_NS: Final = 500_000_000
"""Between two looks for a path past somebody who is in the way [ns]."""
_STANDS_M_S: Final = 0.02
_STANDS_RAD_S: Final = 0.05
_LEFT_M: Final = 0.03
_LEFT_RAD: Final = 0.05
"""A robot that only sways where it came to stand, since the guard holds it, still stands."""
_PROGRESS_M: Final = 0.5
"""Of way driven in which a robot counts as having got on [m]."""
_WAIT_NS: Final = 2_500_000_000
"""At most, for what is in the way to move [ns]."""
_PAUSE_NS: Final = 1_000_000_000
"""Before it plans again on a higher rung: who is in the way gets time to go [ns]."""
_BLIND_NS: Final = 10_000_000_000
"""A robot that sees nothing for this long gives up [ns]."""
_BEHIND_M: Final = (0.05, 0.1, 0.2)
"""How far behind the robot the floor has to be known for it to drive backwards [m]."""
_CHORD_M: Final = 0.25
"""Of a path, by which its direction is told [m]."""
_AWAY_RAD: Final = 1.2
_TURNED_RAD: Final = 0.15
"""A robot that looks farther away than the first turns round until it looks to the second."""
_BACK_M: Final = 0.3
_BACK_M_S: Final = 0.15
_TURN_RAD_S: Final = 0.7
_TRY_NS: Final = 15_000_000_000
"""Backing off or looking around takes no longer [ns]."""


class Journey(Behaviour):
    """Drives to a goal.

    It plans, lets the local controller follow the path round what stands in the way, looks once a
    second for a better one, and plans at once where the path is blocked. In trouble it climbs the
    ladder of `recovery`, and fails with the last reason where that ends.

    Parameters
    ----------
    pilot
        With the map, planner and controller.
    goal, speed_m_s
        Where to, and the largest speed [m/s].

    Attributes
    ----------
    plans
        Paths taken, the first included.
    """

    def __init__(self, pilot: MapPilot, goal: Goal, speed_m_s: float) -> None:
        self._pilot = pilot
        self._goal = goal
        self._speed_m_s = speed_m_s
        self.plans = 0
        self.reset()

    def anchor(self, pose: SE2) -> Anchor:
        """Return where the robot is: it plans from there."""
        return Anchor(pose.x_m, pose.y_m)

    def reset(self) -> None:
        """Start over."""
        self._ladder = Ladder(can_turn=not self._pilot.steered)
        self.pause()

    def pause(self) -> None:
        """Plan anew after the pause."""
        self._route: Route | None = None
        self._planned_ns = 0
        self._planned_reverse = self._pilot.reverse
        self._turns_round = False
        self._attempt: _Attempt | None = None
        self._stuck_ns: int | None = None
        self._stuck_at = SE2()
        self._blind_ns = 0
        self._driven_m = 0.0
        self._last: SE2 | None = None
        self._pilot.controller.reset()

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
        if blindness := self._pilot.blindness:
            self._blind_ns = self._blind_ns or now_ns
            if now_ns - self._blind_ns > _BLIND_NS:
                return failed(f"{blindness} for {_BLIND_NS / 1e9:g} s")
            return BehaviourOutput(0.0, 0.0, text=f"waiting: {blindness}")
        self._blind_ns = 0
        self._note_progress(pose)
        if self._attempt is not None:
            output = self._recover(self._attempt, situation, now_ns)
            if output is not None:
                return output
            self._attempt = None
        route = self._route
        if self._looks_again(pose, now_ns) or route is None:
            found = self._find_route(pose, now_ns)
            if isinstance(found, BehaviourOutput):
                return found
            route = found
        if turn_rad_s := self._turning_round(pose, route):
            return BehaviourOutput(0.0, turn_rad_s, text="turning round to drive in reverse")
        motion = self._looked_at(pose, self._follow(situation, route.plan))
        self._pilot.show(route.rest, motion.ahead)
        if (motion.arrived and route.leads_there) or self._is_there(pose):
            return done()
        if self._is_stuck(situation, motion, now_ns):
            return self._in_trouble(motion.text or "the way is blocked", pose, now_ns)
        text = motion.text or f"{route.left_m:.1f} m to go"
        return BehaviourOutput(motion.v_m_s, motion.omega_rad_s, text=text)

    def _note_progress(self, pose: SE2) -> None:
        """Count the way driven; enough of it, and the next trouble is a new one."""
        if self._last is not None and self._attempt is None:
            self._driven_m += math.dist((pose.x_m, pose.y_m), (self._last.x_m, self._last.y_m))
            if self._driven_m > _PROGRESS_M:
                self._ladder.progress()
        self._last = pose

    def _looks_again(self, pose: SE2, now_ns: int) -> bool:
        """Return whether it is time to plan: there is no path, it is far away, or a while ago."""
        route = self._route
        turned_round = self._planned_reverse is not self._pilot.reverse
        if route is None or turned_round or route.advance(pose) > _OFF_PATH_M:
            self._route = None
            return True
        return now_ns - self._planned_ns >= _REPLAN_NS

    def _plan(self, pose: SE2, now_ns: int) -> Route | PlanFailure:
        """Plan from here; keep the present path where it is free and hardly worse."""
        self._planned_ns, self._planned_reverse = now_ns, self._pilot.reverse
        leads_there = not self._pilot.is_far(pose, self._goal)
        old, answer = self._route, self._pilot.plan(pose, self._goal)
        is_free = old is not None and not self._pilot.touches(old.rest)
        if isinstance(answer, PlanFailure):
            return old if old is not None and is_free else answer
        may_stay = old is not None and is_free and old.leads_there
        if old is not None and may_stay and answer.length_m > _BETTER * old.left_m:
            return old
        self.plans += 1
        return Route(answer, leads_there=leads_there)

    def _is_there(self, pose: SE2) -> bool:
        """Return whether the robot is at a goal where any heading will do."""
        off_m = math.dist((pose.x_m, pose.y_m), (self._goal.x_m, self._goal.y_m))
        any_heading = self._goal.heading_rad is None
        return any_heading and off_m <= self._pilot.config.position_tolerance_m

    def _follow(self, situation: BehaviourInput, plan: Plan) -> LocalMotion:
        """Return the local controller's motion along the path."""
        pilot, pose = self._pilot, situation.pose
        return pilot.controller.step(
            LocalSituation(
                pose,
                situation.twist,
                plan.poses,
                plan.reverse,
                pilot.space_around(pose),
                pilot.moving,
                min(self._speed_m_s, pilot.speed_limit(pose)),
            )
        )

    def _turning_round(self, pose: SE2, route: Route) -> float:
        """Return the turn of a robot that looks the wrong way to drive in reverse [rad/s].

        Controllers look for better velocities near the present one, and straight away from the path
        neither turn is better. 0 where it need not turn, or has no room to.
        """
        back = route.rest[0, :2] - route.rest[:, :2]
        away = np.flatnonzero(np.hypot(*back.T) > _CHORD_M)
        if not self._pilot.reverse or not len(away):
            self._turns_round = False
            return 0.0
        behind_rad = math.atan2(back[away[0], 1], back[away[0], 0])
        off_rad = wrap_angle(behind_rad - pose.theta_rad)
        self._turns_round = abs(off_rad) > (_TURNED_RAD if self._turns_round else _AWAY_RAD)
        if not self._turns_round:
            return 0.0
        side = math.copysign(1.0, off_rad)
        swept = _poses(pose, [SE2(0.0, 0.0, side * turn_rad) for turn_rad in (0.1, 0.2, 0.4)])
        if self._pilot.touches(swept):
            return 0.0
        return side * min(_TURN_RAD_S, 2.0 * abs(off_rad))

    def _looked_at(self, pose: SE2, motion: LocalMotion) -> LocalMotion:
        """Return a motion; none backwards where nothing has seen yet what is there."""
        if motion.v_m_s >= 0.0:
            return motion
        turn = motion.omega_rad_s / motion.v_m_s
        behind = _poses(pose, [SE2.exp(-x_m, 0.0, -x_m * turn) for x_m in _BEHIND_M])
        if self._pilot.is_known(behind):
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
        longest_ns = _PATIENT_NS if self._pilot.is_somebody_near(pose) else _STUCK_NS
        return self._stuck_ns is not None and now_ns - self._stuck_ns > longest_ns

    def _find_route(self, pose: SE2, now_ns: int) -> Route | BehaviourOutput:
        """Return the path to follow from here on, or what to do where there is none."""
        if self._is_patient(pose, now_ns) and now_ns - self._planned_ns < _AGAIN_NS:
            return BehaviourOutput(0.0, 0.0, text="waiting for somebody to pass")
        answer = self._plan(pose, now_ns)
        if isinstance(answer, Route):
            self._route = answer
            return answer
        if why := self._pilot.hopeless(pose, self._goal):
            return failed(why)
        if self._stuck_ns is None:
            self._stuck_ns, self._stuck_at = now_ns, pose
        if self._is_patient(pose, now_ns):
            return BehaviourOutput(0.0, 0.0, text=f"waiting for somebody: {answer.text}")
        return self._in_trouble(answer.text, pose, now_ns)

    def _is_patient(self, pose: SE2, now_ns: int) -> bool:
        """Return whether it waits for somebody who is near and whom it has waited for a while."""
        if self._stuck_ns is None or not self._pilot.is_somebody_near(pose):
            return False
        return now_ns - self._stuck_ns <= _PATIENT_NS

    def _in_trouble(self, reason: str, pose: SE2, now_ns: int) -> BehaviourOutput:
        """Take the next rung of the ladder; fail where there is none."""
        rung = self._ladder.climb()
        self._route, self._stuck_ns, self._driven_m = None, None, 0.0
        if rung is None:
            return failed(f"gave up after {counted(self._ladder.tries, 'try', 'tries')}: {reason}")
        if rung is Rung.CLEAR:
            self._pilot.forget_unseen()
        self._attempt = _Attempt(rung, f"{rung.value}: {reason}", now_ns, pose)
        return BehaviourOutput(0.0, 0.0, text=self._attempt.text)

    def _recover(
        self, attempt: _Attempt, situation: BehaviourInput, now_ns: int
    ) -> BehaviourOutput | None:
        """Return the motion of an attempt; None once it has ended."""
        pose, pilot = situation.pose, self._pilot
        spent_ns = now_ns - attempt.begin_ns
        v, omega = 0.0, 0.0
        if attempt.rung is Rung.WAIT:
            goes_on = spent_ns < _WAIT_NS and not self._may_go_on(situation, now_ns)
        elif attempt.rung is Rung.BACK_OFF:
            v = -_BACK_M_S
            behind = _poses(pose, [SE2(-x_m, 0.0, 0.0) for x_m in _BEHIND_M])
            goes_on = math.dist((pose.x_m, pose.y_m), attempt.begin) < _BACK_M
            goes_on &= pilot.is_known(behind) and not pilot.touches(behind)
        elif attempt.rung is Rung.LOOK_AROUND:
            omega = _TURN_RAD_S
            attempt.turned_rad += abs(wrap_angle(pose.theta_rad - attempt.last_rad))
            attempt.last_rad = pose.theta_rad
            turned = _poses(pose, [SE2(0.0, 0.0, turn_rad) for turn_rad in (0.1, 0.2, 0.4)])
            goes_on = attempt.turned_rad < math.tau and not pilot.touches(turned)
        else:
            goes_on = spent_ns < _PAUSE_NS
        if not goes_on or spent_ns > _TRY_NS:
            return None
        return BehaviourOutput(v, omega, text=attempt.text)

    def _may_go_on(self, situation: BehaviourInput, now_ns: int) -> bool:
        """Return whether there is a path again, and the first step on it is free."""
        if now_ns - self._planned_ns < _AGAIN_NS:
            return False
        answer = self._plan(situation.pose, now_ns)
        if isinstance(answer, PlanFailure):
            return False
        self._route = answer
        motion = self._follow(situation, answer.plan)
        self._pilot.controller.reset()  # nothing has followed this step
        return not motion.blocked


class _Attempt:
    """One rung of the ladder under way."""

    def __init__(self, rung: Rung, text: str, now_ns: int, pose: SE2) -> None:
        self.rung = rung
        self.text = text
        self.begin_ns = now_ns
        self.begin = pose.x_m, pose.y_m
        self.last_rad = pose.theta_rad
        self.turned_rad = 0.0


def _poses(pose: SE2, motions: list[SE2]) -> NDArray[np.float64]:
    """Return where each motion leads to, (n, 3)."""
    ends = [pose @ motion for motion in motions]
    return np.array([(end.x_m, end.y_m, end.theta_rad) for end in ends])


def _has_left(place: SE2, pose: SE2) -> bool:
    """Return whether a robot is elsewhere, or has turned."""
    away_m = math.dist((place.x_m, place.y_m), (pose.x_m, pose.y_m))
    return away_m > _LEFT_M or abs(wrap_angle(pose.theta_rad - place.theta_rad)) > _LEFT_RAD
