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

from native_kernels.compiled import borrows, compiled
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
"""Points of the path that are looked at for a nearer one: a step leads past no more."""
_KNOWN: Final = 16
"""First velocities whose answer is remembered: many samples share one."""


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
    let_pass_s: float
    later_s: float
    """Times for which what moves claims its places, and in which the robot is to keep out of its
    way beyond the horizon."""


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
    motion: Motion,
    v_most: float,
    now: tuple[float, float, float],
    target: tuple[float, float, float],
) -> tuple[float, float, float]:
    """Return the velocity after one step towards a target: forward, turning, sideways.

    `now` is that of the problem, and `v_most` its limit. Of the target, turning is the rate, or the
    curvature of a robot that cannot turn on the spot.
    """
    ahead = min(max(target[0], -v_most), v_most)
    vy = 0.0
    if motion.vy_max > 0.0:
        room = np.sqrt(max(v_most * v_most - ahead * ahead, 0.0))
        most = min(motion.vy_max, room)
        vy = towards(now[2], min(max(target[2], -most), most), motion.a * motion.dt_s)
    v = towards(now[0], ahead, motion.a * motion.dt_s)
    wanted = target[1] if motion.curvature_max == np.inf else v * target[1]
    return v, _turning(motion, v, now[1], wanted, motion.dt_s), vy


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
@borrows
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
@borrows
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
@borrows
def _is_past(problem: RolloutProblem, v: float, omega: float, vy: float) -> bool:
    """Return whether the robot gets out of everybody's way if it goes on like this."""
    x, y, angle = problem.soon
    step_s = problem.tau_s / problem.steps
    moving, sides = problem.space.moving, problem.body.sides
    for i in range(problem.steps):
        half = 0.5 * omega * step_s
        x += v * step_s * np.cos(angle + half)
        y += v * step_s * np.sin(angle + half)
        if vy != 0.0:
            x -= vy * step_s * np.sin(angle + half)
            y += vy * step_s * np.cos(angle + half)
        angle += 2.0 * half
        c, s = float(np.cos(angle)), float(np.sin(angle))
        if gap_to_moving(moving, sides, x, y, c, s, (i + 1) * step_s) <= 0.0:
            return False
    return True


@compiled
@borrows
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
@borrows
def price(
    problem: RolloutProblem, targets: NDArray[np.float64], drawn: NDArray[np.float64]
) -> float:
    """Return the cost of wanted velocities (n, 3), of which the last goes on.

    The places that they lead through are written to `drawn` (m, 3), as far as it has room.
    """
    # Arrays are taken out of the problem here, once: each one that is taken out in the loop, or
    # passed on inside of a tuple, has its references counted there, which costs more than the rest.
    motion, weights, path, gear = problem.motion, problem.weights, problem.path, problem.gear
    clearance, moving = problem.space.clearance, problem.space.moving
    coarse, discs, sides = problem.body.coarse, problem.body.discs, problem.body.sides
    tight_coarse, tight_discs = problem.tight.coarse, problem.tight.discs
    x, y, angle = problem.soon
    c, s = np.cos(angle), np.sin(angle)
    v, omega, vy = problem.v, problem.omega, problem.vy
    spacing, steps, creep, v_most = problem.spacing, problem.steps, motion.creep, problem.v_most
    slide_sways = _slide_sways(motion)
    last, step_s = len(path) - 1, problem.tau_s / steps
    ends = problem.ends
    end_x, end_y = path[last, 0], path[last, 1]
    j = nearest(path, 0, x, y)
    begin = _along(path, spacing, gear, j, x, y)
    lateral = close = people = missing = swayed = 0.0
    along, free = begin, problem.soon
    for i in range(steps):
        k = min(i, len(targets) - 1)
        before, slid = omega, vy
        target = targets[k, 0], targets[k, 1], targets[k, 2]
        if i == 0:
            v, omega, vy = first_velocity(motion, v_most, (v, omega, vy), target)
        else:
            dx, dy, left = end_x - x, end_y - y, np.inf
            if ends:
                left = last * spacing - along
            v, omega, vy = _next_velocity(motion, step_s, target, (v, omega, vy), (dx, dy, left))
        swayed += abs(omega - before) + slide_sways * abs(vy - slid)
        turn = omega * step_s
        x, y, c, s = _driven(x, y, c, s, v * step_s, vy * step_s, turn)
        angle += turn
        moves = abs(v) + abs(omega) + abs(vy) > 1e-9
        if abs(v) <= creep and abs(vy) <= creep:
            near = gap(clearance, tight_coarse, COARSE, tight_discs, x, y, c, s)
        else:
            near = gap(clearance, coarse, COARSE, discs, x, y, c, s)
        if len(moving) > 0:
            # People may walk on into a robot that stands: it had better not stand there.
            crowded = _crowded(moving, sides, weights, (x, y, c, s), (i + 1) * step_s)
            people += crowded
            near = TOUCH if moves and crowded > 1.0 else near
        if near == TOUCH and moves:
            missing = float(steps - i) / steps
            for m in range(i, len(drawn)):  # it stays at the last free place
                drawn[m, 0], drawn[m, 1], drawn[m, 2] = free
            break
        close += max(1.0 - near / weights.comfort, 0.0) ** 2
        j = nearest(path, j, x, y)
        along = _along(path, spacing, gear, j, x, y)
        lateral += abs((y - path[j, 1]) * path[j, 2] - (x - path[j, 0]) * path[j, 3])
        if i < len(drawn):
            drawn[i, 0], drawn[i, 1], drawn[i, 2] = x, y, angle
        free = x, y, angle
    count = max(steps * (1.0 - missing), 1.0)
    full = motion.v_max * problem.tau_s
    if ends:
        full = min(full, max(last * spacing - begin, spacing))
    return (
        weights.goal * (1.0 - (along - begin) / full)
        + weights.path * lateral / count / weights.lateral
        + weights.clearance * close / count
        + weights.heading * _looking_elsewhere(path, spacing, gear, j, problem.ahead, (x, y, c, s))
        + weights.smoothness * swayed / motion.omega_max
        + weights.people
        * (people / count + _in_the_way(problem, x, y, v * c - vy * s, v * s + vy * c))
        + weights.blocked * missing
    )


@compiled
def _next_velocity(
    motion: Motion,
    step_s: float,
    target: tuple[float, float, float],
    now: tuple[float, float, float],
    left: tuple[float, float, float],
) -> tuple[float, float, float]:
    """Return the velocity a step on, on the way to a wanted one; it can brake where the path ends.

    `now` is the velocity there, and `left` how far that end is: along both axes, and along the
    path, inf where the robot need not stop there.
    """
    v, most = towards(now[0], target[0], motion.a * step_s), np.inf
    far = max(left[2], abs(left[0]), abs(left[1]))
    # It need not be known better where half of it is enough to brake.
    if motion.vy_max > 0.0 or v * v > motion.brake * far:
        most = np.sqrt(2.0 * motion.brake * max(np.hypot(left[0], left[1]), left[2]))
        v = min(max(v, -most), most)
    wanted = target[1] if motion.curvature_max == np.inf else v * target[1]
    omega = _turning(motion, v, now[1], wanted, step_s)
    return v, omega, _sliding(motion, now[2], target[2], step_s, v, most)


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
@borrows
def _crowded(
    moving: NDArray[np.float64],
    sides: NDArray[np.float64],
    weights: Weights,
    place: tuple[float, float, float, float],
    time: float,
) -> float:
    """Return 0 to 1, the nearer something that moves is, or soon will be; 2 if they touch."""
    x, y, c, s = place
    now = gap_to_moving(moving, sides, x, y, c, s, time)
    if now <= 0.0:
        return 2.0
    pass_s = weights.let_pass_s
    later = gap_to_moving(moving, sides, x, y, c, s, time + pass_s)
    between = gap_to_moving(moving, sides, x, y, c, s, time + 0.5 * pass_s)
    least = max(min(now, between, later), 0.0)
    return max(1.0 - least / weights.people_comfort, 0.0) ** 2


@compiled
@borrows
def _in_the_way(problem: RolloutProblem, x: float, y: float, on_x: float, on_y: float) -> float:
    """Return 0 to 1, the closer people will come to a robot that goes on from x, y like that."""
    most, comfort, late = 0.0, problem.weights.people_comfort, problem.weights.later_s
    for i in range(len(problem.space.moving)):
        mx, my, vx, vy, radius = problem.space.moving[i]
        dx, dy = mx + problem.tau_s * vx - x, my + problem.tau_s * vy - y
        vx, vy = vx - on_x, vy - on_y
        later = min(max(-(dx * vx + dy * vy) / (vx * vx + vy * vy + 1e-9), 0.0), late)
        gap = np.hypot(dx + later * vx, dy + later * vy) - radius - problem.body.reach
        most = max(most, 1.0 - max(gap, 0.0) / comfort)
    return most * most


@compiled
@borrows
def _looking_elsewhere(
    path: NDArray[np.float64],
    spacing: float,
    gear: float,
    j: int,
    ahead: int,
    place: tuple[float, float, float, float],
) -> float:
    """Return 0 if the robot looks to the path ahead of its point j, 1 if it looks away from it."""
    x, y, c, s = place
    target = min(j + ahead, len(path) - 1)
    on_x, on_y = gear * (path[target, 0] - x), gear * (path[target, 1] - y)
    length = float(np.hypot(on_x, on_y))
    aligned = float(c * path[target, 2] + s * path[target, 3])
    if length > 2.0 * spacing:
        aligned = (c * on_x + s * on_y) / length
    return 0.5 * (1.0 - aligned)


@compiled
@borrows
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
    motion, v_most, now = problem.motion, problem.v_most, (problem.v, problem.omega, problem.vy)
    for i in range(len(targets)):
        target = targets[i, 0, 0], targets[i, 0, 1], targets[i, 0, 2]
        v, omega, vy = first_velocity(motion, v_most, now, target)
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
