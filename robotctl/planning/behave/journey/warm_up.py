"""Warm-up: a journey of one step on a small map, for which all code is compiled."""

from __future__ import annotations

from typing import Final

import numpy as np

from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.model.grid_map import OCCUPIED, GridMap
from robotctl.planning.map.layered_map import LayeredMap
from robotctl.planning.path.global_planning.plan import Plan, Planner
from robotctl.planning.path.global_planning.route import Route
from robotctl.planning.path.local.controller import Controller, LocalSituation

_ROUNDS: Final = 20
"""Rounds of planning: enough to call everything, while a planner that improves its path goes on."""


def warm_up(planner: Planner, controller: Controller, footprint: Footprint) -> None:
    """Plan and drive a step."""
    side_m = max(footprint.reach_m, 1.0)
    cells = np.zeros((13, 13), np.int8)
    cells[:9, 6] = OCCUPIED
    live = LayeredMap(GridMap(cells, side_m), footprint)
    start, goal = (SE2(x * side_m, 2.5 * side_m, 0.0) for x in (2.5, 10.5))
    rounds = iter(range(_ROUNDS))
    plan = planner.plan(live.space(), start, goal, lambda: next(rounds, None) is not None)
    if isinstance(plan, Plan):
        route = Route(plan)
        controller.step(
            LocalSituation(
                start,
                Twist(0.0, 0.0),
                plan.poses,
                plan.reverse,
                live.space_around(start, side_m),
                np.array([[9.0 * side_m, 2.5 * side_m, 0.0, 0.0, 0.2]]),
                1.0,
            )
        )
        live.collides(route.rest)
    controller.reset()
