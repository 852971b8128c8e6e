"""Consequences of velocities: all candidates are rolled out and priced at once.

A candidate is a sequence of wanted velocities; the robot follows them within its accelerations. It
is admissible if the robot, after one step with its first velocity, can still stop before it
touches anything (Fox, Burgard, Thrun, "The dynamic window approach to collision avoidance", 1997).
All lengths are in cells of the map, times in seconds.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robotctl.compiled import compiled
from robotctl.planning.path.local.body import (
    COARSE,
    TOUCH,
    Body,
    Surroundings,
    can_stop,
    gap,
    gap_to_moving,
)

_AHEAD: Final = 2
"""Points of the path that are looked at for a nearer one."""
_KNOWN: Final = 16
"""First velocities that are remembered."""
_LET_PASS_S: Final = 0.8
"""Time ahead for which a moving thing claims the places that it is going to [s]."""
_LATER_S: Final = 2.0
"""Time beyond the horizon in which the robot should not be in anybody's way."""


class Motion(NamedTuple):
    """How the robot moves, in cells and seconds."""

    v_max: float
    omega_max: float
    vy_max: float
    """Sideways; 0 of a robot that cannot move so."""
    a: float
    alpha: float
    curvature_max: float
    """Maximum curvature of its path: 1 / smallest turning radius; inf if it turns on the spot."""
    brake: float
    """Deceleration that it manages for sure."""
    turn_brake: float
    """The same of turning [rad/s^2]."""
    reaction_s: float
    creep: float
    """Maximum speed that needs no margin."""
    dt_s: float


class Weights(NamedTuple):
    """Weights of the costs; lengths in cells."""

    goal: float
    path: float
    clearance: float
    heading: float
    smoothness: float
    blocked: float
    people: float
    lateral: float
    """Distance from the path that costs 1."""
    comfort: float
    """Gap from which on nearness costs nothing."""
    people_comfort: float


class RolloutProblem(NamedTuple):
    """All that a step depends on."""

    space: Surroundings
    body: Body
    """With its margin."""
    tight: Body
    """Nearly without."""
    motion: Motion
    weights: Weights
    pose: tuple[float, float, float]
    """Pose at which the robot is seen."""
    soon: tuple[float, float, float]
    """Pose at which the next velocity takes effect."""
    v: float
    omega: float
    vy: float
    path: NDArray[np.float64]
    """(n, 4): x, y, cosine and sine of the heading there, from near the robot on."""
    spacing: float
    """Spacing of the points of the path."""
    ends: bool
    """Whether the robot is to stop at the last point."""
    gear: float
    """1, or -1 in reverse."""
    ahead: int
    """Points of the path from the nearest to the one that the robot is to look at."""
    tau_s: float
    steps: int
    v_most: float
    """Speed from which it can stop at the last point, where it is to."""


@compiled
def towards(value: float, target: float, change: float) -> float:
    """Return a value moved to a target by a change at most."""
    return min(max(target, value - change), value + change)


@compiled
def first_velocity(
    problem: RolloutProblem, v_target: float, turn: float, vy_target: float
) -> tuple[float, float, float]:
    """Return the velocity after one step towards a target: forward, turning, sideways.

    `turn` is the rate, or the curvature of a robot that cannot turn on the spot.
    """
    motion = problem.motion
    target = min(max(v_target, -problem.v_most), problem.v_most)
    vy = 0.0
    if motion.vy_max > 0.0:
        room = np.sqrt(max(problem.v_most * problem.v_most - target * target, 0.0))
        most = min(motion.vy_max, room)
        vy = towards(problem.vy, min(max(vy_target, -most), most), motion.a * motion.dt_s)
    v = towards(problem.v, target, motion.a * motion.dt_s)
    wanted = turn if motion.curvature_max == np.inf else v * turn
    return v, _turning(motion, v, problem.omega, wanted, motion.dt_s), vy


@compiled
def _turning(motion: Motion, v: float, omega: float, wanted: float, time: float) -> float:
    """Return the turn rate after some time."""
    omega = towards(omega, wanted, motion.alpha * time)
    most = motion.omega_max
    if motion.curvature_max != np.inf:
        most = min(most, abs(v) * motion.curvature_max)
    return min(max(omega, -most), most)


@compiled
def braked(problem: RolloutProblem) -> tuple[float, float, float]:
    """Return the velocity after one step of braking on the present arc."""
    motion = problem.motion
    speed = float(np.hypot(problem.v, problem.vy))
    brake_s = max(speed / motion.brake, abs(problem.omega) / motion.turn_brake)
    share = max(1.0 - motion.dt_s / brake_s, 0.0) if brake_s > 0.0 else 0.0
    return problem.v * share, problem.omega * share, problem.vy * share


@compiled
def is_admissible(problem: RolloutProblem, v: float, omega: float, vy: float) -> bool:
    """Return whether the robot can stop after a step with a velocity.

    It takes effect between at once and after the reaction time: both are looked at. People who walk
    on would run into a robot that stops in their way, so it may also drive on if it gets out of it.
    """
    if _can_stop(problem, problem.space, v, omega, vy):
        return True
    space = problem.space
    if len(space.moving) == 0:
        return False
    still = Surroundings(space.blocked, space.clearance, space.moving[:0])
    return _can_stop(problem, still, v, omega, vy) and _is_past(problem, v, omega, vy)


@compiled
def _can_stop(
    problem: RolloutProblem, space: Surroundings, v: float, omega: float, vy: float
) -> bool:
    """Return whether nothing is touched before the robot stands."""
    motion = problem.motion
    speed = float(np.hypot(v, vy))
    brake_s = max(speed / motion.brake, abs(omega) / motion.turn_brake)
    body = problem.tight if speed <= motion.creep else problem.body
    late_s = motion.dt_s + motion.reaction_s
    return can_stop(space, body, problem.pose, v, omega, vy, late_s, brake_s) and can_stop(
        space, body, problem.soon, v, omega, vy, motion.dt_s, brake_s
    )


@compiled
def _is_past(problem: RolloutProblem, v: float, omega: float, vy: float) -> bool:
    """Return whether the robot gets out of everybody's way if it goes on like this."""
    x, y, angle = problem.soon
    step_s = problem.tau_s / problem.steps
    for i in range(problem.steps):
        half = 0.5 * omega * step_s
        x += v * step_s * np.cos(angle + half)
        y += v * step_s * np.sin(angle + half)
        if vy != 0.0:
            x -= vy * step_s * np.sin(angle + half)
            y += vy * step_s * np.cos(angle + half)
        angle += 2.0 * half
        c, s = float(np.cos(angle)), float(np.sin(angle))
        if gap_to_moving(problem.space, problem.body, x, y, c, s, (i + 1) * step_s) <= 0.0:
            return False
    return True


@compiled
def nearest(path: NDArray[np.float64], j: int, x: float, y: float) -> int:
    """Return the path's point nearest to a place, from a near one on."""
    least = (path[j, 0] - x) ** 2 + (path[j, 1] - y) ** 2
    best, k = j, j
    while k < min(best + _AHEAD, len(path) - 1):
        k += 1
        squared = (path[k, 0] - x) ** 2 + (path[k, 1] - y) ** 2
        if squared < least:
            least, best = squared, k
    return best


@compiled
def price(
    problem: RolloutProblem, targets: NDArray[np.float64], drawn: NDArray[np.float64]
) -> float:
    """Return the cost of wanted velocities (n, 3), of which the last goes on.

    The places that they lead through are written to `drawn` (m, 3), as far as it has room.
    """
    motion, weights, path, gear = problem.motion, problem.weights, problem.path, problem.gear
    moving = len(problem.space.moving) > 0
    x, y, angle = problem.soon
    c, s = np.cos(angle), np.sin(angle)
    v, omega, vy = problem.v, problem.omega, problem.vy
    slide_sways = _slide_sways(motion)
    last, step_s = len(path) - 1, problem.tau_s / problem.steps
    j = nearest(path, 0, x, y)
    begin = _along(path, problem.spacing, gear, j, x, y)
    lateral = close = people = missing = swayed = 0.0
    along = begin
    for i in range(problem.steps):
        k = min(i, len(targets) - 1)
        before, slid = omega, vy
        if i == 0:
            v, omega, vy = first_velocity(problem, targets[0, 0], targets[0, 1], targets[0, 2])
        else:
            target = targets[k, 0], targets[k, 1], targets[k, 2]
            v, omega, vy = _next_velocity(problem, target, (v, omega, vy), x, y, along)
        swayed += abs(omega - before) + slide_sways * abs(vy - slid)
        turn = omega * step_s
        x, y, c, s = _driven(x, y, c, s, v * step_s, vy * step_s, turn)
        angle += turn
        moves = abs(v) + abs(omega) + abs(vy) > 1e-9
        near = _gap_at(problem, v, vy, (x, y, c, s))
        if moving:
            # People may walk on into a robot that stands: it had better not stand there.
            crowded = _crowded(problem, problem.body, (x, y, c, s), (i + 1) * step_s)
            people += crowded
            near = TOUCH if moves and crowded > 1.0 else near
        if near == TOUCH and moves:
            missing = float(problem.steps - i) / problem.steps
            for m in range(i, len(drawn)):  # it stays at the last free place
                if i > 0:
                    drawn[m] = drawn[i - 1]
                else:
                    drawn[m, 0], drawn[m, 1], drawn[m, 2] = problem.soon
            break
        close += max(1.0 - near / weights.comfort, 0.0) ** 2
        j = nearest(path, j, x, y)
        along = _along(path, problem.spacing, gear, j, x, y)
        lateral += abs((y - path[j, 1]) * path[j, 2] - (x - path[j, 0]) * path[j, 3])
        if i < len(drawn):
            drawn[i, 0], drawn[i, 1], drawn[i, 2] = x, y, angle
    count = max(problem.steps * (1.0 - missing), 1.0)
    full = motion.v_max * problem.tau_s
    if problem.ends:
        full = min(full, max(last * problem.spacing - begin, problem.spacing))
    return (
        weights.goal * (1.0 - (along - begin) / full)
        + weights.path * lateral / count / weights.lateral
        + weights.clearance * close / count
        + weights.heading * _looking_elsewhere(problem, j, (x, y, c, s))
        + weights.smoothness * swayed / motion.omega_max
        + weights.people
        * (people / count + _in_the_way(problem, x, y, v * c - vy * s, v * s + vy * c))
        + weights.blocked * missing
    )


@compiled
def _next_velocity(
    problem: RolloutProblem,
    target: tuple[float, float, float],
    now: tuple[float, float, float],
    x: float,
    y: float,
    along: float,
) -> tuple[float, float, float]:
    """Return the velocity a step on, on the way to a wanted one; it can brake where the path ends.

    `now` is the velocity there, (x, y) the place, and `along` how far that is along the path.
    """
    motion, path, step_s = problem.motion, problem.path, problem.tau_s / problem.steps
    v, most = towards(now[0], target[0], motion.a * step_s), np.inf
    if problem.ends:
        last = len(path) - 1
        way = np.hypot(path[last, 0] - x, path[last, 1] - y)
        way = max(way, last * problem.spacing - along)
        most = np.sqrt(2.0 * motion.brake * way)
        v = min(max(v, -most), most)
    wanted = target[1] if motion.curvature_max == np.inf else v * target[1]
    omega = _turning(motion, v, now[1], wanted, step_s)
    return v, omega, _sliding(motion, now[2], target[2], step_s, v, most)


@compiled
def _gap_at(
    problem: RolloutProblem, v: float, vy: float, here: tuple[float, float, float, float]
) -> float:
    """Return the gap around the body; where it creeps, around the body with less margin."""
    creeps = abs(v) <= problem.motion.creep and abs(vy) <= problem.motion.creep
    body = problem.tight if creeps else problem.body
    x, y, c, s = here
    return gap(problem.space.clearance, body.coarse, COARSE, body.discs, x, y, c, s)


@compiled
def _driven(
    x: float, y: float, c: float, s: float, ahead: float, aside: float, turn: float
) -> tuple[float, float, float, float]:
    """Return place, cosine and sine of the heading after a step, along the heading halfway."""
    # Cosine and sine of half the turn by series: they are right to 1e-6 up to 1 rad.
    half = 0.25 * turn * turn
    ch = 1.0 - half * (0.5 - half * (1.0 / 24.0 - half / 720.0))
    sh = 0.5 * turn * (1.0 - half * (1.0 / 6.0 - half * (1.0 / 120.0 - half / 5040.0)))
    c, s = c * ch - s * sh, s * ch + c * sh
    x, y = x + ahead * c - aside * s, y + ahead * s + aside * c
    return x, y, c * ch - s * sh, s * ch + c * sh


@compiled
def _slide_sways(motion: Motion) -> float:
    """Return the change of the turn rate that counts as much as one of the speed sideways."""
    return motion.omega_max / motion.vy_max if motion.vy_max > 0.0 else 0.0


@compiled
def _sliding(motion: Motion, vy: float, wanted: float, time: float, v: float, most: float) -> float:
    """Return the speed sideways after some time towards what is wanted, at `most` with `v`."""
    if motion.vy_max <= 0.0:
        return 0.0
    room = np.sqrt(max(most * most - v * v, 0.0))
    return float(min(max(towards(vy, wanted, motion.a * time), -room), room))


@compiled
def _crowded(
    problem: RolloutProblem, body: Body, place: tuple[float, float, float, float], time: float
) -> float:
    """Return 0 to 1, the nearer something that moves is, or soon will be; 2 if they touch."""
    x, y, c, s = place
    now = gap_to_moving(problem.space, body, x, y, c, s, time)
    if now <= 0.0:
        return 2.0
    later = gap_to_moving(problem.space, body, x, y, c, s, time + _LET_PASS_S)
    between = gap_to_moving(problem.space, body, x, y, c, s, time + 0.5 * _LET_PASS_S)
    least = max(min(now, between, later), 0.0)
    return max(1.0 - least / problem.weights.people_comfort, 0.0) ** 2


@compiled
def _in_the_way(problem: RolloutProblem, x: float, y: float, on_x: float, on_y: float) -> float:
    """Return 0 to 1, the closer people will come to a robot that goes on from x, y like that."""
    most, comfort = 0.0, problem.weights.people_comfort
    for i in range(len(problem.space.moving)):
        mx, my, vx, vy, radius = problem.space.moving[i]
        dx, dy = mx + problem.tau_s * vx - x, my + problem.tau_s * vy - y
        vx, vy = vx - on_x, vy - on_y
        later = min(max(-(dx * vx + dy * vy) / (vx * vx + vy * vy + 1e-9), 0.0), _LATER_S)
        gap = np.hypot(dx + later * vx, dy + later * vy) - radius - problem.body.reach
        most = max(most, 1.0 - max(gap, 0.0) / comfort)
    return most * most


@compiled
def _looking_elsewhere(
    problem: RolloutProblem, j: int, place: tuple[float, float, float, float]
) -> float:
    """Return 0 if the robot looks to the path ahead of its point j, 1 if it looks away from it."""
    x, y, c, s = place
    path, gear = problem.path, problem.gear
    target = min(j + problem.ahead, len(path) - 1)
    on_x, on_y = gear * (path[target, 0] - x), gear * (path[target, 1] - y)
    length = float(np.hypot(on_x, on_y))
    aligned = float(c * path[target, 2] + s * path[target, 3])
    if length > 2.0 * problem.spacing:
        aligned = (c * on_x + s * on_y) / length
    return 0.5 * (1.0 - aligned)


@compiled
def _along(
    path: NDArray[np.float64], spacing: float, gear: float, j: int, x: float, y: float
) -> float:
    """Return the length along the path to where a place lies beside it."""
    on = float(gear * ((x - path[j, 0]) * path[j, 2] + (y - path[j, 1]) * path[j, 3]))
    least = -spacing if j > 0 else -np.inf
    return j * spacing + min(max(on, least), spacing)


@compiled
def cheapest(
    problem: RolloutProblem, targets: NDArray[np.float64], drawn: NDArray[np.float64]
) -> tuple[int, float, float, float]:
    """Return which candidate of (n, steps, 3) is the cheapest, and its first velocity.

    -1 if none is admissible, with the velocity of braking. Its places are written to `drawn`.
    """
    best, least = -1, np.inf
    chosen = braked(problem)
    known, count = np.empty((_KNOWN, 4)), 0
    nothing = np.empty((0, 3))
    for i in range(len(targets)):
        v, omega, vy = first_velocity(problem, targets[i, 0, 0], targets[i, 0, 1], targets[i, 0, 2])
        # Far targets have the same first step.
        admissible = -1.0
        for k in range(min(count, _KNOWN)):
            if known[k, 0] == v and known[k, 1] == omega and known[k, 2] == vy:
                admissible = known[k, 3]
        if admissible < 0.0:
            admissible = 1.0 if is_admissible(problem, v, omega, vy) else 0.0
            known[count % _KNOWN] = v, omega, vy, admissible
            count += 1
        if admissible > 0.0:
            cost = price(problem, targets[i], nothing)
            if cost < least:
                best, least, chosen = i, cost, (v, omega, vy)
    price(problem, targets[best] if best >= 0 else np.zeros((1, 3)), drawn)
    return best, chosen[0], chosen[1], chosen[2]
