"""Every global planner with every way to drive, and why there is no path."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Final, get_args

import numpy as np

from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import OCCUPIED, GridMap
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.path.global_planning.plan import Plan, PlannerConfig, Steering
from robotctl.planning.path.global_planning.planners import PLANNERS
from robotctl.workbench.planning.plan import min_clearance_m

_ROUNDS: Final = 50
"""Rounds of planning: some planners would improve their path for long."""

_LONG: Final = ((0.4, -0.18), (0.4, 0.18), (-0.2, 0.18), (-0.2, -0.18))
"""Corners of a body that cannot turn in the door [m]."""


def warm_up() -> None:
    """Plan around a wall, once against one without a gap, and once through a narrow door."""
    cells = np.zeros((13, 13), np.int8)
    cells[:9, 6] = OCCUPIED
    space = PlanningMap(GridMap(cells, 1.0), Footprint())
    start, goal = SE2(2.5, 2.5), SE2(10.5, 2.5)
    for make in PLANNERS.values():
        for steering in get_args(Steering):
            config = PlannerConfig(steering=steering, turning_radius_m=1.0)
            rounds = iter(range(_ROUNDS))
            found = make(config).plan(space, start, goal, partial(_goes_on, rounds))
            if isinstance(found, Plan):
                min_clearance_m(space, found)
    closed = cells.copy()
    closed[:, 6] = OCCUPIED
    PLANNERS["astar"](PlannerConfig()).plan(
        PlanningMap(GridMap(closed, 1.0), Footprint()), start, goal
    )
    cells = np.zeros((40, 40), np.int8)
    cells[:, 20] = OCCUPIED
    cells[17:22, 20] = 0
    door = PlanningMap(GridMap(cells, 0.1), Footprint(_LONG))
    PLANNERS["astar"](PlannerConfig()).plan(door, SE2(0.65, 1.95), SE2(3.35, 1.95))


def _goes_on(rounds: Iterator[int]) -> bool:
    return next(rounds, None) is not None
