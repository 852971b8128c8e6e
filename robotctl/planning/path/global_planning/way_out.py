"""Paths from where a robot has no room: they begin beside it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.se2 import SE2
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.path.global_planning.goal import facing
from robotctl.planning.path.global_planning.plan import GoesOn, Plan, PlanFailure, Planner, Reason

_NO_ROOM: Final = frozenset({Reason.START_BLOCKED, Reason.NOT_FOUND})
_WAYS_OUT_M: Final = (
    *((-0.1, 0.0), (0.1, 0.0), (0.0, 0.05), (0.0, -0.05), (-0.2, 0.0), (0.2, 0.0)),
    *((0.0, 0.1), (0.0, -0.1), (-0.4, 0.0), (0.4, 0.0)),
    *((0.3, 0.2), (0.3, -0.2), (-0.3, 0.2), (-0.3, -0.2)),
    *((0.3, 0.4), (0.3, -0.4), (-0.3, 0.4), (-0.3, -0.4)),
)
"""Steps from a place without room to one with room, forward and to the left [m]."""
_AWAY: Final = 2000
"""A robot that reaches more poses than this has room where it stands: its search has failed
elsewhere, and would again from each place beside it."""
_SECTORS: Final = 16
"""Directions in each of which the nearest exit is looked for."""


def find_way(
    planner: Planner, space: PlanningMap, start: SE2, goal: SE2, goes_on: GoesOn, *, steered: bool
) -> Plan | PlanFailure:
    """Return a path that the robot can take from where it is.

    Where it has no room to turn, or stands nearer to something than its outline allows, the path
    begins beside it: straight on or back, which it drives first, or a little to the side, where the
    local controller gets away from what is too near.
    """
    answer = planner.plan(space, start, goal, goes_on)
    if not isinstance(answer, PlanFailure) or answer.reason not in _NO_ROOM:
        return answer
    can_leave = answer.expanded > _AWAY or (not steered and space.can_turn_at(start, 0.0))
    if answer.reason is Reason.NOT_FOUND and can_leave:
        return answer
    for on_m, aside_m in _WAYS_OUT_M:
        out = start @ SE2(on_m, aside_m, 0.0)
        if not space.has_room_at(out):
            continue
        other = planner.plan(space, out, goal, goes_on)
        if isinstance(other, Plan):
            return other if aside_m else _led_by(start, other, reverse=on_m < 0.0)
    return answer


def _led_by(start: SE2, plan: Plan, *, reverse: bool) -> Plan:
    """Return a path with a straight piece before it."""
    first = [start.x_m, start.y_m, start.theta_rad]
    poses = np.vstack([first, plan.poses])
    return replace(plan, poses=poses, reverse=np.concatenate([[reverse], plan.reverse]))


def lead_out(
    space: PlanningMap,
    outside: NDArray[np.bool_],
    start: SE2,
    plan_to: Callable[[SE2], Plan | PlanFailure],
) -> Plan | PlanFailure:
    """Return the shortest path to a place outside of where the robot should not be.

    Parameters
    ----------
    space
        The map, in which the robot may pass there.
    outside
        (rows, columns): the places that will do.
    start
        Where it is, in `world`.
    plan_to
        Returns a path to a place.
    """
    cells = np.argwhere(outside)
    if not len(cells):
        text = "the robot stands where it should keep out, and the map has no other place for it"
        return PlanFailure(Reason.START_BLOCKED, text, (start.x_m, start.y_m))
    here = space.to_cells(start)
    ways = cells[:, ::-1] + 0.5 - (here.x_m, here.y_m)
    away = np.hypot(*ways.T)
    sectors = np.floor((np.arctan2(ways[:, 1], ways[:, 0]) / math.tau + 0.5) * _SECTORS)
    order = np.lexsort((away, sectors))
    firsts = order[np.flatnonzero(np.diff(sectors[order], prepend=-1.0))]
    exits = space.grid.centre_of(cells[firsts[np.argsort(away[firsts])]])
    best = plan_to(facing(start, *exits[0].tolist()))
    for x_m, y_m in exits[1:].tolist():
        if isinstance(best, Plan):
            if best.length_m <= math.dist((start.x_m, start.y_m), (x_m, y_m)):
                break
            found = plan_to(facing(start, x_m, y_m))
            if isinstance(found, Plan) and found.length_m < best.length_m:
                best = found
        else:
            best = plan_to(facing(start, x_m, y_m))
    return best
