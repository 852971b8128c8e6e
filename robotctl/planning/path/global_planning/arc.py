"""Arcs to goals that move: for robots that steer, which would manoeuvre to meet each exactly."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from robotctl.model.geometry.se2 import SE2
from robotctl.planning.path.global_planning.goal import Goal
from robotctl.planning.path.global_planning.plan import Plan

_STEP_M: Final = 0.05
_FARTHEST_M: Final = 2.0
"""Largest distance of the goal [m]; a planned path to one farther away may turn first."""
_WIDEST_RAD: Final = 1.0
"""Bearing of a goal up to which an arc leads there without a detour [rad]."""


def arc_to(start: SE2, goal: Goal, radius_m: float) -> Plan | None:
    """Return the arc ahead that leads to a goal with any heading.

    None: the goal is far away or beside the robot, or the arc is tighter than a radius [m].
    """
    off = start.inverse() @ SE2(goal.x_m, goal.y_m, 0.0)
    chord_m, bearing_rad = math.hypot(off.x_m, off.y_m), math.atan2(off.y_m, off.x_m)
    if goal.heading_rad is not None or not 0.0 < chord_m <= _FARTHEST_M:
        return None
    # The chord of an arc is turned by half of its angle.
    bend_per_m = 2.0 * math.sin(bearing_rad) / chord_m
    if abs(bearing_rad) > _WIDEST_RAD or abs(bend_per_m) * radius_m > 1.0:
        return None
    length_m = chord_m if bend_per_m == 0.0 else 2.0 * bearing_rad / bend_per_m
    along_m = np.linspace(0.0, length_m, math.ceil(length_m / _STEP_M) + 1).tolist()
    ends = [start @ SE2.exp(s_m, 0.0, s_m * bend_per_m) for s_m in along_m]
    return Plan(np.array([(end.x_m, end.y_m, end.theta_rad) for end in ends]), length_m, 0)
