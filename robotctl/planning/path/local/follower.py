"""Follows a path: what the local controllers share; each brings its own search for a velocity."""

from __future__ import annotations

import math
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from robotctl.control.limiter import LimitsConfig
from robotctl.model.drives.drives import Drive
from robotctl.model.drives.motion import integrate
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.path.local.arrival import Arrival
from robotctl.planning.path.local.body import Body, Surroundings, is_narrow, make_body
from robotctl.planning.path.local.controller import ControllerConfig, LocalMotion, LocalSituation
from robotctl.planning.path.local.escape import intrusions, is_too_near, way_out
from robotctl.planning.path.local.rollout import (
    Motion,
    RolloutProblem,
    Weights,
    cheapest,
    towards,
)
from robotctl.planning.path.local.track import Track

_TIGHT: Final = 0.25
"""Least margin [cells]: what the outline's points may miss."""
_TIGHT_M: Final = 0.0125
"""Least margin [m]: by how much the pose may be wrong."""
_TARGET: Final = 20
"""Point of the path that a robot makes for that gets away from something: about a metre on."""
_SWING_M: Final = 0.0025
"""Distance by which the tail of a robot that turns away from something may swing towards it [m]:
what the obstacle guard takes for turning beside it."""
_NARROW_M: Final = 0.7
"""Distance ahead of a narrow place from which on the robot keeps to its path [m]."""
_BESIDE_WALL_M: Final = 1.0
"""The same before a goal where it cannot turn."""
_STILL: Final = 1e-3
"""Velocity below which the robot stands [m/s, rad/s]: rounding."""
_TOUCHED: Final = "something touches the robot"


class Choice(NamedTuple):
    """Result of a search."""

    v: float
    omega: float
    ahead: NDArray[np.float64]
    """(steps, 3) poses that it leads through [cells, cells, rad]."""
    vy: float = 0.0


class CommandSearch(Protocol):
    """Chooses the next velocity."""

    steps: int
    """How many the time ahead is cut into."""

    def reset(self) -> None:
        """Forget the last step."""

    def choose(self, problem: RolloutProblem, effort: float) -> Choice:
        """Return the best admissible velocity; if there is none, that of braking.

        `effort` is the share of its samples that may be tried, in (0, 1].
        """


class Follower:
    """A controller of any kind; its first step compiles all kernels.

    Parameters
    ----------
    config, drive, limits, footprint
        Of the robot.
    search
        Chooses velocities.
    """

    def __init__(
        self,
        config: ControllerConfig,
        drive: Drive,
        limits: LimitsConfig,
        footprint: Footprint,
        search: CommandSearch,
    ) -> None:
        self._config = config
        self._limits = limits
        self._footprint = footprint
        self._search = search
        self._radius = drive.min_turning_radius_m
        self._steered = drive.steered
        self._vy_max = limits.vy_max_m_s if drive.holonomic else 0.0
        share = min(1.0, config.deceleration_m_s2 / limits.a_max_m_s2)
        self._turn_brake = share * limits.alpha_max_rad_s2
        self._arrival = Arrival(config, drive, limits.omega_max_rad_s, self._turn_brake)
        self._bodies: dict[float, tuple[Body, Body]] = {}
        self._bare: dict[float, Body] = {}
        self._path: NDArray[np.float64] = np.empty((0, 3))
        self._is_cold = True
        self.reset()

    def reset(self) -> None:
        """Forget the last step: the path is another one, or the robot was moved."""
        self._track: Track | None = None
        self._last: Twist | None = None
        self._drawn_in: Body | None = None
        """Body that must stay free while it gets away from what is too near; None: it need not."""
        self._search.reset()

    def step(self, situation: LocalSituation) -> LocalMotion:
        """Return the next velocity, from which the robot can always stop before it touches."""
        motion = self._step(situation)
        self._last = Twist(motion.v_m_s, motion.omega_rad_s, motion.vy_m_s)
        return motion

    def _step(self, situation: LocalSituation) -> LocalMotion:
        """Arrive, back off, or follow the path."""
        track = self._follow(situation)
        problem = self._problem(situation, track)
        if self._is_cold:
            self._compile(problem, situation)
        narrow = is_narrow(
            problem.space, problem.body, problem.tight,
            problem.path[: math.ceil(_NARROW_M / track.section.spacing_m)],
        )  # fmt: skip
        narrow = narrow or self._is_hemmed_in(situation, track)
        along = self._steered or narrow
        if self._is_near(situation.pose, track, along=along):
            return self._arrive(situation, track, problem, along=along)
        if self._backing_m > 0.0:
            return self._back(situation, problem)
        if narrow:
            kept = self._keep_to_path(situation, track, problem)
            if kept is not None:
                return kept
        return self._moving(situation, problem, self._search.choose(problem, situation.effort))

    def _compile(self, problem: RolloutProblem, situation: LocalSituation) -> None:
        """Call all that is compiled once: no later step may wait for it."""
        self._is_cold = False
        self._only(problem, 0.0, 0.0)
        is_too_near(problem.space, problem.tight, problem.pose)
        side_m = situation.space.grid.resolution_m
        bare = self._bare[side_m]
        self._drawn(problem, side_m)
        way_out(problem, bare, bare, (0.0, 0.0), side_m)
        self._search.choose(problem, 1.0)
        self._search.reset()

    def _follow(self, situation: LocalSituation) -> Track:
        """Return the track with the robot's place on it."""
        track, pose = self._track, situation.pose
        if track is None or situation.path is not self._path:
            self._path = situation.path
            track = self._track = Track(situation.path, situation.reverse)
            self._arrival.reset()
            self._waited, self._backing_m, self._backs = 0, 0.0, 0
        track.advance(pose)
        at_end = track.reference(pose).way_m <= 0.5 * self._config.position_tolerance_m
        if at_end and not track.is_last and situation.twist.speed_m_s < 0.05:
            track.next_section()
            track.advance(pose)
            self._search.reset()
            self._arrival.reset()
        return track

    def _is_hemmed_in(self, situation: LocalSituation, track: Track) -> bool:
        """Return whether the path leads to the goal's heading, and the robot cannot turn there."""
        goal = track.goal
        if not track.is_last or track.remaining_m > _BESIDE_WALL_M:
            return False
        space, there = situation.space, situation.space.to_cells(goal)
        turn_rad = wrap_angle(float(track.section.points[-1, 2]) - goal.theta_rad)
        led_there = abs(turn_rad) < self._config.heading_tolerance_rad
        on_map = space.contains(there.x_m, there.y_m)
        return led_there and on_map and not space.can_turn_at(goal, self._config.margin_m)

    def _is_near(self, pose: SE2, track: Track, *, along: bool) -> bool:
        """Return whether the robot is about to arrive, or along the path to change gear, too."""
        if along:
            here = track.reference(pose)
            return here.way_m <= self._arrival.near_m and abs(here.beside_m) < self._config.beside_m
        if not track.is_last:
            return False
        goal, near_m = track.goal, self._arrival.near_m
        distance = math.hypot(goal.x_m - pose.x_m, goal.y_m - pose.y_m)
        return distance <= near_m and track.remaining_m <= 1.5 * near_m

    def _problem(self, situation: LocalSituation, track: Track) -> RolloutProblem:
        """Return the situation in cells of its map."""
        config, space, speed = self._config, situation.space, situation.speed_m_s
        side_m = space.grid.resolution_m
        if side_m not in self._bodies:
            tight_m = max(_TIGHT * side_m, _TIGHT_M)
            self._bodies[side_m] = (
                make_body(self._footprint, max(config.margin_m, tight_m), side_m),
                make_body(self._footprint, tight_m, side_m),
            )
            self._bare[side_m] = make_body(self._footprint, 0.0, side_m)
        body, tight = self._bodies[side_m]
        v_max = min(speed, self._limits.v_max_m_s)
        points, ends = track.window(v_max * config.tau_s + 2.0 * config.look_m)
        v_most = v_max
        if ends:
            x_m, y_m, _ = points[-1].tolist()
            way_m = math.dist((situation.pose.x_m, situation.pose.y_m), (x_m, y_m))
            way_m = max(way_m, track.remaining_m)
            v_most = min(v_max, math.sqrt(2.0 * config.deceleration_m_s2 * way_m))
        present = self._present(situation.twist)
        pose = space.to_cells(situation.pose)
        soon = space.to_cells(self._soon(situation))
        return RolloutProblem(
            Surroundings(space.blocked, space.clearance, _in_cells(space, situation.moving)),
            body,
            tight,
            self._motion(v_max, side_m),
            self._weights(side_m),
            (pose.x_m, pose.y_m, pose.theta_rad),
            (soon.x_m, soon.y_m, soon.theta_rad),
            float(present.v_m_s) / side_m,
            float(present.omega_rad_s),
            float(present.vy_m_s) / side_m,
            _path_in_cells(space, points),
            track.section.spacing_m / side_m,
            ends,
            -1.0 if track.section.reverse else 1.0,
            max(1, round(config.look_m / track.section.spacing_m)),
            config.tau_s,
            self._search.steps,
            v_most / side_m,
        )

    def _present(self, twist: Twist) -> Twist:
        """Return the velocity from which the next one starts.

        It is that of the last command, which a measurement does not show yet; if the robot cannot
        follow, as near to that as it may be by now.
        """
        if self._last is None:
            return twist
        limits, late_s = self._limits, self._config.dt_s + self._config.reaction_s
        vy_m_s = 0.0
        if self._vy_max > 0.0:
            vy_m_s = towards(twist.vy_m_s, self._last.vy_m_s, limits.a_max_m_s2 * late_s)
        return Twist(
            towards(twist.v_m_s, self._last.v_m_s, limits.a_max_m_s2 * late_s),
            towards(twist.omega_rad_s, self._last.omega_rad_s, limits.alpha_max_rad_s2 * late_s),
            vy_m_s,
        )

    def _soon(self, situation: LocalSituation) -> SE2:
        """Return where the robot is when its next velocity takes effect."""
        now, then = situation.twist, self._present(situation.twist)
        mean = Twist(
            0.5 * (now.v_m_s + then.v_m_s),
            0.5 * (now.omega_rad_s + then.omega_rad_s),
            0.5 * (now.vy_m_s + then.vy_m_s),
        )
        return integrate(situation.pose, mean, self._config.reaction_s)

    def _motion(self, v_max_m_s: float, side_m: float) -> Motion:
        """Return how the robot moves, in cells."""
        config, limits = self._config, self._limits
        return Motion(
            v_max_m_s / side_m,
            limits.omega_max_rad_s,
            min(self._vy_max, v_max_m_s) / side_m,
            limits.a_max_m_s2 / side_m,
            limits.alpha_max_rad_s2,
            side_m / self._radius if self._radius > 0.0 else math.inf,
            config.deceleration_m_s2 / side_m,
            self._turn_brake,
            config.reaction_s,
            config.creep_m_s / side_m,
            config.dt_s,
        )

    def _weights(self, side_m: float) -> Weights:
        """Return what counts how much, in cells."""
        config = self._config
        return Weights(
            config.goal,
            config.path,
            config.clearance,
            config.heading,
            config.smoothness,
            config.blocked,
            config.people,
            config.lateral_m / side_m,
            config.comfort_m / side_m,
            config.people_m / side_m,
            config.let_pass_s,
            config.later_s,
        )

    def _arrive(
        self, situation: LocalSituation, track: Track, problem: RolloutProblem, *, along: bool
    ) -> LocalMotion:
        """Follow the law of arrival, or the path up to its end, as far as the way is free."""
        side_m = situation.space.grid.resolution_m
        pose, steered = situation.pose, self._steered
        if along:
            wanted = self._arrival.along(self._soon(situation), track, situation.speed_m_s)
        elif self._vy_max > 0.0:
            speed = situation.speed_m_s
            wanted = self._arrival.slide(pose, track.goal, speed, min(self._vy_max, speed))
        else:
            wanted = self._arrival.step(pose, track.goal, situation.speed_m_s)
        problem = problem._replace(v_most=problem.motion.v_max)
        for share in (1.0, 0.5, 0.25):
            v, omega = share * wanted.v_m_s / side_m, share * wanted.omega_rad_s
            turn = omega / v if steered and v != 0.0 else omega
            free, choice = self._only(problem, v, turn, share * wanted.vy_m_s / side_m)
            if free:
                motion = _motion(situation, choice)
                if not track.is_last:
                    return motion
                text = "the goal is missed, another path leads there" if wanted.missed else ""
                still = _is_still(motion)
                return motion._replace(
                    arrived=wanted.arrived and still, blocked=wanted.missed and still, text=text
                )
        text = "something is too near to the goal"
        return _motion(situation, choice)._replace(blocked=True, text=text)

    def _keep_to_path(
        self, situation: LocalSituation, track: Track, problem: RolloutProblem
    ) -> LocalMotion | None:
        """Stay on the path, at a creep where it must; None: it is not free, or is not kept to.

        A path that leads back to where the narrow place begins is none to keep to.
        """
        pose, side_m = self._soon(situation), situation.space.grid.resolution_m
        here = track.reference(pose)
        if abs(here.beside_m) > self._config.beside_m or abs(here.turned_rad) > 0.5 * math.pi:
            return None
        wanted = self._arrival.keep_to(pose, track, situation.speed_m_s)
        creeps = min(1.0, self._config.creep_m_s / max(abs(wanted.v_m_s), _STILL))
        for share in (1.0, creeps):
            v, omega = share * wanted.v_m_s / side_m, share * wanted.omega_rad_s
            turn = omega / v if self._steered and v != 0.0 else omega
            free, choice = self._only(problem, v, turn)
            if free:
                self._waited, self._drawn_in = 0, None
                self._search.reset()
                return _motion(situation, choice)
        return None

    def _back(self, situation: LocalSituation, problem: RolloutProblem) -> LocalMotion:
        """Back off straight, against the gear, while that is free."""
        speed = problem.motion.creep
        free, choice = self._only(problem._replace(v_most=speed), -problem.gear * speed, 0.0)
        motion = _motion(situation, choice)
        self._backing_m -= self._config.dt_s * motion.speed_m_s if free else math.inf
        return motion._replace(text="backs off")

    def _only(
        self, problem: RolloutProblem, v: float, turn: float, vy: float = 0.0
    ) -> tuple[bool, Choice]:
        """Return whether one velocity is admissible; and it, else that of braking."""
        ahead = np.empty((problem.steps, 3))
        best, v, omega, vy = cheapest(problem, np.array([[[v, turn, vy]]]), ahead)
        return best == 0, Choice(v, omega, ahead, vy)

    def _moving(
        self, situation: LocalSituation, problem: RolloutProblem, choice: Choice
    ) -> LocalMotion:
        """Return a chosen velocity and say what hinders the robot."""
        side_m = situation.space.grid.resolution_m
        motion = _motion(situation, choice)
        still = _is_still(motion)
        self._waited = self._waited + 1 if still else 0
        people = self._waits_for_people(problem, side_m)
        patient = people or self._waited < self._config.waiting_steps
        touches = still and is_too_near(problem.space, problem.tight, problem.pose)
        if touches or (still and not patient) or self._drawn_in is not None:
            away = self._escape(situation, problem, choice)
            if away is not None:
                return away
        self._drawn_in = None
        if not still:
            slow = motion.speed_m_s < 0.5 * situation.speed_m_s
            return motion._replace(text="lets somebody pass" if people and slow else "")
        if self._waited < self._config.waiting_steps:
            return motion
        if self._backs < self._config.backs and not people:
            self._waited, self._backing_m, self._backs = 0, self._config.back_m, self._backs + 1
        text = "waits for somebody to pass" if people else "no way on along the path"
        return motion._replace(blocked=True, text=text)

    def _escape(
        self, situation: LocalSituation, problem: RolloutProblem, choice: Choice
    ) -> LocalMotion | None:
        """Creep away from what is within the margin, or along it; None: no need to."""
        if not is_too_near(problem.space, problem.body, problem.pose):
            return None
        side_m = situation.space.grid.resolution_m
        drawn_in = self._drawn_in
        if drawn_in is None or is_too_near(problem.space, drawn_in, problem.pose):
            drawn_in = self._drawn_in = self._drawn(problem, side_m)
        v = omega = 0.0
        if drawn_in is not None:
            path = problem.path
            at = min(_TARGET, len(path) - 1)
            target = float(path[at, 0]), float(path[at, 1])
            v, omega = way_out(problem, self._bare[side_m], drawn_in, target, side_m)
        motion = _motion(situation, choice)
        if v == 0.0 and omega == 0.0:
            touches = is_too_near(problem.space, problem.tight, problem.pose)
            return motion._replace(blocked=True, text=_TOUCHED) if touches else None
        motion = _motion(situation, Choice(v, omega, choice.ahead))
        return motion._replace(text="creeps away from what is too near", creeps=True)

    def _drawn(self, problem: RolloutProblem, side_m: float) -> Body | None:
        """Return the body without what things reach into it; None: they leave nothing."""
        depths = intrusions(problem.space.blocked, self._bare[side_m], problem.pose, _TIGHT)
        swing = _SWING_M / side_m
        margins = np.where(depths > 0.0, -depths - swing, -0.5 * depths)
        try:
            return make_body(self._footprint, (margins * side_m).tolist(), side_m)
        except ValueError:
            return None

    def _waits_for_people(self, problem: RolloutProblem, side_m: float) -> bool:
        """Return whether something that moves is near."""
        x, y, _ = problem.pose
        moving = problem.space.moving
        away = np.hypot(moving[:, 0] - x, moving[:, 1] - y) - moving[:, 4]
        return bool((away * side_m < 2.0).any())


def _motion(situation: LocalSituation, choice: Choice) -> LocalMotion:
    """Return a choice in metres and `world`."""
    space = situation.space
    side_m = space.grid.resolution_m
    return LocalMotion(
        float(choice.v) * side_m,
        float(choice.omega),
        space.to_world(choice.ahead),
        vy_m_s=float(choice.vy) * side_m,
    )


def _is_still(motion: LocalMotion) -> bool:
    """Return whether a velocity is that of a robot that stands."""
    return motion.speed_m_s < _STILL and abs(motion.omega_rad_s) < _STILL


def _in_cells(space: PlanningMap, moving: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what moves, in the map's frame and cells."""
    origin, side_m = space.grid.origin, space.grid.resolution_m
    c, s = math.cos(origin.theta_rad), math.sin(origin.theta_rad)
    x, y, vx, vy, radius = (moving / side_m).T
    x, y = x - origin.x_m / side_m, y - origin.y_m / side_m
    return np.stack([c * x + s * y, c * y - s * x, c * vx + s * vy, c * vy - s * vx, radius], 1)


def _path_in_cells(space: PlanningMap, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return x, y, cosine and sine of each pose in the map's frame."""
    origin, side_m = space.grid.origin, space.grid.resolution_m
    c, s = math.cos(origin.theta_rad), math.sin(origin.theta_rad)
    x, y = (points[:, 0] - origin.x_m) / side_m, (points[:, 1] - origin.y_m) / side_m
    angles = points[:, 2] - origin.theta_rad
    return np.stack([c * x + s * y, c * y - s * x, np.cos(angles), np.sin(angles)], 1)
