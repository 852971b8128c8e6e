"""Slow down and stop ahead of what the sensors see where the robot's body is going."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

from robotctl.model.footprint import Footprint
from robotctl.model.geometry.twist import Twist
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.braking import speed_before
from robotctl.planning.config import GuardConfig
from robotctl.planning.guard.course import LEAST_CLOSING, Course, Point
from robotctl.planning.guard.echo_motion import ApproachingEcho

if TYPE_CHECKING:  # numpy would be slow to load for each process that reads a robot's file
    import numpy as np
    from numpy.typing import NDArray

    from robotctl.control.limiter import LimitsConfig
    from robotctl.model.footprint_arrays import Sides

_ECHO_MARGIN_M: Final = 0.03
"""Way that the body keeps to an echo that it has passed."""
_SIDEWAYS: Final = 0.1
"""A sonar looks to the side if its axis has less than this ahead, or behind."""
_ASIDE: Final = math.cos(math.radians(30.0))
"""A sonar looks aside of the course if less of its axis is along it."""
_HALF_CONE_RAD: Final = math.radians(12.5)
"""Half the opening of a sonar's cone."""
_SAME_M: Final = 0.04
"""Error by which an echo may still come from the wall beside [m]; a sonar that is nearer to that
than it can measure tells 3 cm."""
_PASSING: Final = 0.2
"""One that approaches what comes nearer by less than this passes it, if it does so slowly: standing
would not keep the two apart."""
_GRAZE_M_S: Final = 0.04
"""Maximum speed of a corner that cannot hurt anybody it moves towards [m/s]."""


class GuardStep(NamedTuple):
    """The guard's limit."""

    v_max_m_s: float
    """Maximum speed in the requested direction [m/s], >= 0; inf with nothing near. On the spot,
    that of the body's outermost corner, which is `ObstacleGuard.reach_m` from `base`."""
    obstacle: str
    """Obstacle that limits the speed, as text; empty if there is none."""


_STRAIGHT_ON: Final = Course(1.0, 0.0, 0.0)


_SHARES: Final = (1.0, 0.5, 0.2)
"""Shares of a velocity that are looked at."""
_TURNS_INTO: Final = "something is where the robot would slide to"
_REST: Final = Twist(0.0, 0.0)
_BLIND: Final = "the lidar gives no scans"


class _View(NamedTuple):
    """One sonar and the wall it may see."""

    slot: int
    name: str
    place: Point
    """In `base` [m]."""
    normal: Point
    """Axis of the sonar, a unit vector of `base`."""
    reaches_m: tuple[float, ...]
    """How far each corner of the body reaches beyond the sonar, to where that looks [m]."""


class ObstacleGuard:
    """Limits the speed so that braking ends `margin_m` before the obstacle.

    An echo counts as a wall perpendicular to the axis of its sonar, and each corner of the body is
    asked for its way up to there: gap / closing rate, on the straight line or the arc that is asked
    for. So a wall beside the robot leaves the more distance the less it is approached, in a bend or
    backwards with the wheels turned it is the outer corners that come near, and a motion away from
    a wall is free.

    A wall at an angle is seen better by the neighbouring sonar, to whose axis it is more nearly so:
    with a sonar every 45 degrees it is off by 22.5 degrees at most from one of them, which makes 8
    % of way, and less than `margin_m` at the corners. The sonars ahead alone would not do: a wall
    met at less than 45 degrees gives them no echo at all.

    The body is its outline or, where none is given, the rectangle from the rearmost to the foremost
    sonar, `half_width_m` to each side and at least to its outermost sonar. The median of the last
    three readings of each sonar keeps single outliers and lost echoes out. A sonar ahead without
    reading (nan) makes the robot stand: it would drive blind. Without a sonar in the direction of
    travel there is nothing to guard, and the speed is free; `looks` tells who must know. Points on
    the floor, which a camera sees, count where the robot driving straight on would meet them.

    Points of a lidar are exact: each counts where the body, nose and tail included, would touch it
    on the arc that is asked for, or as it turns on the spot. Who is seen to move, and comes nearer,
    finds the body at rest, wherever it moves towards them. Echoes do not hinder a turn on the spot,
    or a robot in a corner would never leave it. What a sonar that looks aside of the course hears
    where a lidar has points counts as those. A robot whose lidar is silent stands where no sonar
    looks.

    Echoes that a robot without lidar has passed count like the points of a lidar, up to where the
    body would touch them.

    Parameters
    ----------
    config
        See there.
    mounts
        The sonars, in the order of the ranges.
    has_lidar
        Whether the robot has a lidar, whose points are waited for.
    limits
        Speed limits of a holonomic robot: of what a lidar shows, it also meets nothing while it
        changes from one course to another. None for all others.
    outline
        Of the body, where the robot's file tells it.

    Attributes
    ----------
    body
        The outline that counts.
    reach_over_m
        How far the body is taken to reach over the floor, ahead and behind, and to each side [m].
    """

    def __init__(
        self,
        config: GuardConfig,
        mounts: Sequence[SonarMount],
        *,
        has_lidar: bool = False,
        limits: LimitsConfig | None = None,
        outline: Footprint | None = None,
    ) -> None:
        self._config = config
        self._mounts = mounts
        self._answered: tuple[Twist, GuardStep] | None = None
        """The last motion that was asked for since something was observed, and its limit."""
        if outline is not None:
            self.use_body(outline)
        else:
            corners = _corners(mounts, config.half_width_m)
            self._take(config.outline(mounts), corners, (config.nose_m, config.half_width_m))
        self._cosine = math.cos(math.radians(config.cone_deg))
        self._history: list[list[float]] = []
        self._readings_m: list[float] = []
        """Medians of the last readings [m]."""
        self._count = len(mounts)
        self._has_lidar = has_lidar
        self._limits = limits
        self.reset()

    def retune(self, config: GuardConfig) -> None:
        """Brake by other settings; the body stays as it is."""
        self._config = config
        self._cosine = math.cos(math.radians(config.cone_deg))
        self._answered = None

    def use_body(self, outline: Footprint) -> None:
        """Guard another body from now on."""
        length_m = max(outline.front_m, -outline.rear_m)
        self._take(outline, outline.points, (length_m, max(outline.left_m, outline.right_m)))

    def _take(
        self, body: Footprint, corners: Sequence[Point], reach_over_m: tuple[float, float]
    ) -> None:
        """Take a body, with the corners that count for sonars and its reach over the floor."""
        self.body, self._corners, self.reach_over_m = body, corners, reach_over_m
        self._views = [_view(index, mount, corners) for index, mount in enumerate(self._mounts)]
        self._sides: Sides | None = None
        self._edge: NDArray[np.float64] | None = None
        self._answered = None

    def reset(self) -> None:
        """Forget past readings."""
        self._history = [[] for _ in range(self._count)]
        self._readings_m = [math.nan] * self._count
        self._floor: Sequence[Point] = ()
        self._points: NDArray[np.float64] | None = None
        self._approaches: Sequence[ApproachingEcho] = ()
        self._passed: NDArray[np.float64] | None = None
        self._moving: Sequence[Sequence[float]] = ()
        self._twist = _REST
        self._answered = None

    @property
    def body_sides(self) -> Sides:
        """The sides of the body."""
        from robotctl.model.footprint_arrays import side_rows  # noqa: PLC0415 - see above

        if self._sides is None:
            self._sides = side_rows(self.body)
        return self._sides

    @property
    def reach_m(self) -> float:
        """Distance from `base` to the outermost corner of the body [m]."""
        return self.body.reach_m

    def observe(
        self,
        ranges_m: Sequence[float],
        new: Sequence[bool],
        floor_base: Sequence[Point] = (),
        points_base: NDArray[np.float64] | None = None,
        approaches: Sequence[ApproachingEcho] = (),
        passed_base: NDArray[np.float64] | None = None,
        twist: Twist = _REST,
        moving_base: Sequence[Sequence[float]] = (),
    ) -> None:
        """Take sonar ranges, floor points and a lidar's points; once per step.

        Parameters
        ----------
        ranges_m
            The last reading of each sonar [m].
        new
            Whether it has come since the last step: each counts once, but a missing one (nan)
            with each step, since nothing new may come any more.
        floor_base
            Points of the floor in `base` [m].
        points_base
            (n, 2) points in `base` that the body must not touch [m]; None: nobody looks for them.
        approaches
            What comes nearer to each sonar by itself; none: all stands.
        passed_base
            (n, 2) echoes in `base` that no sonar may hear any more [m].
        twist
            Present velocity of `base`; only that of a holonomic robot counts.
        moving_base
            What a lidar sees move: x, y, vx, vy in `base` and radius of each [m, m/s].
        """
        self._moving = moving_base
        self._twist = twist
        self._answered = None
        self._passed = passed_base
        self._floor = floor_base
        self._points = points_base
        self._approaches = approaches
        for past, reading, is_new in zip(self._history, ranges_m, new, strict=True):
            # A repeated reading must not outvote new ones in the median.
            if is_new or math.isnan(reading):
                past.append(reading)
                if len(past) > 3:
                    del past[0]
        self._readings_m = [_median(past) for past in self._history]

    def looks(self, direction: float) -> bool:
        """Say whether a sonar looks forwards (`direction` > 0) or backwards (< 0)."""
        return self._looks(Course(math.copysign(1.0, direction), 0.0, 0.0))

    def _looks(self, course: Course) -> bool:
        """Say whether a sonar looks where `base` goes."""
        return any(self._is_ahead(view, course) for view in self._views)

    def step(self, v_m_s: float, omega_rad_s: float = 0.0, vy_m_s: float = 0.0) -> GuardStep:
        """Return the limit for a motion of `base`, whose arc is what counts and not its speed.

        Parameters
        ----------
        v_m_s
            Forwards > 0, backwards < 0 [m/s].
        omega_rad_s
            With it, to the left > 0 [rad/s].
        vy_m_s
            With it, sideways to the left > 0 [m/s].
        """
        wanted = Twist(v_m_s, omega_rad_s, vy_m_s)
        if self._answered is None or self._answered[0] != wanted:
            self._answered = wanted, self._limit(wanted)
        return self._answered[1]

    def _limit(self, wanted: Twist) -> GuardStep:
        """Return the limit for a motion."""
        allowed = self._step(Course.of(*wanted))
        allowed = min(allowed, self._near_people(), key=lambda each: each.v_max_m_s)
        if self._limits is None or self._points is None:
            return allowed
        change = self._while_changing(self._points, wanted, allowed.v_max_m_s, self._limits)
        return min(allowed, change, key=lambda each: each.v_max_m_s)

    def _step(self, course: Course) -> GuardStep:
        """Return the limit on a course."""
        if course.is_on_the_spot:
            limits = [self._on_the_spot(course.turn)]
        else:
            distance_m, obstacle = self._free(course, self._views)
            stands = GuardStep(self._speed_for(distance_m), obstacle)
            limits = [self._speed_before_others(course), stands]
        limits.append(self._speed_before_movers(course))
        return min(limits, key=lambda each: each.v_max_m_s)

    @property
    def sees_ahead(self) -> bool:
        """Whether a sonar or lidar looks ahead."""
        return self._has_lidar or self.looks(1.0)

    def free_ahead(self) -> tuple[float, str]:
        """Return how far `base` may drive straight on [m], inf: without end; and what is there.

        Only sonars that look ahead count: others see walls that the robot would pass.
        """
        views = [view for view in self._views if self._is_ahead(view, _STRAIGHT_ON)]
        return self._free(_STRAIGHT_ON, views)

    def _free(self, course: Course, views: Sequence[_View]) -> tuple[float, str]:
        """Return the way of `base` on an arc until an obstacle's margin [m], and which obstacle."""
        if self._is_blind and not self._looks(course):
            return 0.0, _BLIND
        moves = self._moves(course)
        # The margin is kept by the corner, which moves hypot(x, y) times as far as `base`.
        margins_m = [self._config.margin_m / max(math.hypot(x, y), LEAST_CLOSING) for x, y in moves]
        distance_m, obstacle = math.inf, ""
        for view in views:
            reading = self._readings_m[view.slot]
            if math.isnan(reading):
                if self._is_ahead(view, course):
                    # Blind ahead: stand still rather than guess.
                    return 0.0, f"sonar {view.name} gives no reading"
                continue
            free = _free_distance(view, reading, moves, margins_m)
            if (
                free < distance_m
                and not (free <= 0.0 and self._is_wall_beside(view, reading))
                and not self._is_seen_aside(view, reading, course)
            ):
                distance_m, obstacle = free, f"{view.name} measures {reading:.2f} m"
        on_floor = self._free_floor(course)
        if on_floor - self._config.margin_m < distance_m:
            distance_m = on_floor - self._config.margin_m
            obstacle = f"something lies on the floor {on_floor:.2f} m away"
        free, place = self._free_way(course)
        if free < distance_m:
            distance_m, obstacle = free, place
        return distance_m, obstacle

    def _moves(self, course: Course) -> list[Point]:
        """Return the motion of each corner per distance of `base` on an arc."""
        ahead, left, turn = course
        return [(ahead - turn * y_m, left + turn * x_m) for x_m, y_m in self._corners]

    def _while_changing(
        self, points: NDArray[np.float64], wanted: Twist, v_max_m_s: float, limits: LimitsConfig
    ) -> GuardStep:
        """Return the limit that lets a robot stop on its way from the present velocity.

        `v_max_m_s` is the limit on the wanted course.
        """
        from robotctl.planning.guard.change_of_course import (  # noqa: PLC0415 - see above
            Agility,
            is_free,
        )

        a, alpha = limits.a_max_m_s2, limits.alpha_max_rad_s2
        sure = min(self._config.deceleration_m_s2, a)
        agility = Agility((a, alpha, a), (sure, alpha * sure / a, sure), self._config.reaction_s)
        speed = wanted.speed_m_s or abs(wanted.omega_rad_s) * self.reach_m
        if speed == 0.0:
            return GuardStep(math.inf, "")
        most = min(v_max_m_s / speed, 1.0)
        for share in _SHARES:
            slower = Twist(*(most * share * each for each in wanted))
            if is_free(self.body_sides, points, self._twist, slower, agility):
                return GuardStep(math.inf if share == 1.0 else most * share * speed, _TURNS_INTO)
        return GuardStep(0.0, _TURNS_INTO)

    def _speed_before_others(self, course: Course) -> GuardStep:
        """Return the speed from which `base` stands before what comes nearer is there."""
        v_max_m_s, who = math.inf, ""
        near = [
            (view, echo)
            for view, echo in zip(self._views, self._approaches, strict=False)
            if echo.speed_m_s > 0.0
        ]
        if not near:
            return GuardStep(v_max_m_s, who)
        moves = self._moves(course)
        for view, (range_m, nears_m_s) in near:
            for reach_m, (x, y) in zip(view.reaches_m, moves, strict=True):
                closing = view.normal[0] * x + view.normal[1] * y
                if closing <= LEAST_CLOSING:
                    continue
                v_m_s = self._speed_before(closing, range_m - reach_m, nears_m_s)
                if v_m_s < v_max_m_s:
                    v_max_m_s, who = v_m_s, f"{view.name} sees something that may come nearer"
        return GuardStep(v_max_m_s, who)

    def _speed_before_movers(self, course: Course) -> GuardStep:
        """Return the same before what a lidar sees move; on the spot, of the outermost corner."""
        if not self._moving:
            return GuardStep(math.inf, "")
        from robotctl.planning.guard.movers import edge_of, encounters  # noqa: PLC0415 - see above

        if self._edge is None:
            self._edge = edge_of(self.body)
        found = encounters(self._edge, self._moving, course, self.reach_m)
        v_max_m_s = min((self._speed_before(*each) for each in found), default=math.inf)
        return GuardStep(v_max_m_s, "somebody comes nearer")

    def _speed_before(self, closing: float, gap_m: float, nears_m_s: float) -> float:
        """Return the largest speed from which a part of the body stops a margin before a person.

        Parameters
        ----------
        closing
            Way of that part towards the person per way of `base`, > 0.
        gap_m, nears_m_s
            Distance from the person [m], and that person's speed [m/s].
        """
        config = self._config
        v_m_s = speed_before(
            gap_m - config.margin_m,
            nears_m_s,
            config.deceleration_m_s2,
            config.reaction_s,
            closing=closing,
        )
        return max(v_m_s, _GRAZE_M_S / closing) if closing <= _PASSING else v_m_s

    def _near_people(self) -> GuardStep:
        """Return the limit of a robot that is to be slow near people, wherever it drives."""
        people, config = self._config.people, self._config
        if people.near_m <= 0.0:
            return GuardStep(math.inf, "")
        gaps = [
            (echo.range_m - max(view.reaches_m), echo.speed_m_s)
            for view, echo in zip(self._views, self._approaches, strict=False)
            if echo.speed_m_s > 0.0
        ]
        for x_m, y_m, vx_m_s, vy_m_s, radius_m in self._moving:
            nears_m_s = -(x_m * vx_m_s + y_m * vy_m_s) / max(math.hypot(x_m, y_m), radius_m)
            gaps.append((-self.body.depth_m(x_m, y_m) - radius_m, max(nears_m_s, 0.0)))
        v_max_m_s = min(
            speed_before(
                gap_m - people.near_m,
                nears_m_s,
                config.deceleration_m_s2,
                config.reaction_s,
                then_m_s=people.speed_m_s,
            )
            for gap_m, nears_m_s in [*gaps, (math.inf, 0.0)]
        )
        return GuardStep(v_max_m_s, "somebody is near")

    def _on_the_spot(self, turn: float) -> GuardStep:
        """Return the limit of the outermost corner, which brakes as the robot does."""
        if turn == 0.0:
            return GuardStep(math.inf, "")
        if self._is_blind and not self._views:
            return GuardStep(0.0, _BLIND)
        free_rad, place = self._free_way(Course(0.0, 0.0, turn))
        return GuardStep(self._speed_for(free_rad * self.reach_m), place)

    @property
    def _is_blind(self) -> bool:
        """Whether the lidar gives no points."""
        return self._has_lidar and self._points is None

    def _free_way(self, course: Course) -> tuple[float, str]:
        """Return the way of `base` until the body is a margin away from a point, and which.

        In metres, or on the spot in radians.
        """
        from robotctl.planning.guard.swept_body import free_way  # noqa: PLC0415 - see above

        free, where = math.inf, ""
        for points, margin_m, what in (
            (self._points, self._config.margin_m, "something is"),
            (self._passed, _ECHO_MARGIN_M, "something was heard"),
        ):
            if points is None:
                continue
            way, place = free_way(self.body_sides, points, margin_m, course)
            if place is not None and way < free:
                free = way
                where = f"{what} at x {place[0]:.2f} m, y {place[1]:.2f} m of the robot"
        return free, where

    def _is_ahead(self, view: _View, course: Course) -> bool:
        """Say whether a sonar looks in the direction of travel."""
        return course.ahead * view.normal[0] + course.left * view.normal[1] >= self._cosine

    def _is_wall_beside(self, view: _View, reading: float) -> bool:
        """Say whether an echo is that of a wall close beside, measured by the sonar that faces it.

        A sonar at an angle hears that wall at the edge of its cone, and would take it to be ahead.
        """
        x, y = view.normal
        for side in self._views:
            if abs(side.normal[0]) > _SIDEWAYS or side.normal[1] * y <= _SIDEWAYS:
                continue
            beside_m = self._readings_m[side.slot]
            if not beside_m - max(side.reaches_m) < self._config.margin_m:
                continue
            towards = side.normal[0] * x + side.normal[1] * y
            off_m = beside_m + sum(
                n * (a - b) for n, a, b in zip(side.normal, side.place, view.place, strict=True)
            )
            edge_rad = math.acos(min(towards, 1.0)) - _HALF_CONE_RAD
            if edge_rad > 0.0 and reading >= off_m / math.cos(edge_rad) - _SAME_M:
                return True
        return False

    def _is_seen_aside(self, view: _View, reading: float, course: Course) -> bool:
        """Say whether a sonar that looks aside of the course hears what a lidar sees in its cone.

        That is a point and no wall, and counts as one: the jamb of a door that the robot passes.
        What stands lower where the robot goes is heard by the sonars that look there.
        """
        facing = course.ahead * view.normal[0] + course.left * view.normal[1]
        if self._points is None or facing > _ASIDE:
            return False
        from robotctl.planning.guard.swept_body import is_in_cone  # noqa: PLC0415 - see above

        return is_in_cone(self._points, view.place, view.normal, reading, _SAME_M, _HALF_CONE_RAD)

    def _free_floor(self, course: Course) -> float:
        """Return the way of `base` straight on until it meets a point on the floor [m].

        The body counts as far back as ahead, and as wide on both sides.
        """
        ways = (_way_to(point, course, *self.reach_over_m) for point in self._floor)
        return min(ways, default=math.inf)

    def _speed_for(self, distance_m: float) -> float:
        """Return the speed v with v reaction + v^2 / (2 a) = distance [m/s]."""
        if distance_m <= 0.0:
            return 0.0
        delay = self._config.deceleration_m_s2 * self._config.reaction_s
        return math.sqrt(delay * delay + 2.0 * self._config.deceleration_m_s2 * distance_m) - delay


def _free_distance(
    view: _View, reading: float, moves: Sequence[Point], margins_m: Sequence[float]
) -> float:
    """Return the distance of `base` until the first corner is its margin away from a wall [m].

    `moves` is the motion of each corner per distance of `base`, and margins are ways of `base`.
    """
    distance_m = math.inf
    normal_x, normal_y = view.normal
    for reach_m, (x, y), margin_m in zip(view.reaches_m, moves, margins_m, strict=True):
        closing = normal_x * x + normal_y * y
        if closing > LEAST_CLOSING:
            distance_m = min(distance_m, (reading - reach_m) / closing - margin_m)
    return distance_m


def _way_to(point: Point, course: Course, nose_m: float, half_m: float) -> float:
    """Return the way straight on until a body meets a point [m]; below 0: it is on it; inf: never.

    A point that the body is on counts as long as more of the body is still to pass over it.
    """
    enters, leaves = -math.inf, math.inf
    for at, reach_m, share in zip(point, (nose_m, half_m), course[:2], strict=True):
        if share == 0.0:
            if abs(at) >= reach_m:
                return math.inf
            continue
        on_m = math.copysign(at, at * share)
        enters = max(enters, (on_m - reach_m) / abs(share))
        leaves = min(leaves, (on_m + reach_m) / abs(share))
    return enters if enters < leaves and enters + leaves > 0.0 else math.inf


def _corners(mounts: Sequence[SonarMount], half_width_m: float) -> list[Point]:
    """Return the corners of the body, whose length is taken from the sonars."""
    ends = {min((m.x_m for m in mounts), default=0.0), max((m.x_m for m in mounts), default=0.0)}
    half_m = max(half_width_m, *(abs(m.y_m) for m in mounts)) if mounts else half_width_m
    return [(x_m, side * half_m) for x_m in sorted(ends) for side in (1.0, -1.0)]


def _view(index: int, mount: SonarMount, corners: Sequence[Point]) -> _View:
    """Return what counts of a sonar."""
    cos, sin = math.cos(mount.heading_rad), math.sin(mount.heading_rad)
    reaches_m = tuple(cos * (x_m - mount.x_m) + sin * (y_m - mount.y_m) for x_m, y_m in corners)
    return _View(index, mount.name, (mount.x_m, mount.y_m), (cos, sin), reaches_m)


def _median(readings: list[float]) -> float:
    """Return the median of at most three readings; nan if most are nan or there is none."""
    valid = sorted([reading for reading in readings if not math.isnan(reading)])
    if 2 * len(valid) <= len(readings):
        return math.nan
    # Of two, the nearer: the second reading of an obstacle already stops the robot.
    return valid[(len(valid) - 1) // 2]
