"""Paths from where a robot has no room: they begin beside it."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from robotctl.model.geometry.se2 import SE2
from robotctl.planning.costmap.planning_map import PlanningMap
from robotctl.planning.global_planning.plan import GoesOn, Plan, PlanFailure, Planner, Reason

_NO_ROOM: Final = frozenset({Reason.START_BLOCKED, Reason.NOT_FOUND})
_WAYS_OUT_M: Final = (
    *((-0.1, 0.0), (0.1, 0.0), (0.0, 0.05), (0.0, -0.05), (-0.2, 0.0), (0.2, 0.0)),
    *((0.0, 0.1), (0.0, -0.1), (-0.4, 0.0), (0.4, 0.0)),
)
"""From a place without room to one with: on and to the left [m]."""


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
    if not steered and answer.reason is Reason.NOT_FOUND and space.can_turn_at(start):
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
