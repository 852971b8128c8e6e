"""The registry of global planners: one line makes a planner one of `robotctl plan`'s."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from robotctl.planning.global_planning.grid_planner import GridPlanner
from robotctl.planning.global_planning.hybrid_planner import HybridPlanner
from robotctl.planning.global_planning.plan import Planner, PlannerConfig
from robotctl.planning.global_planning.tree_planners import Rrt, RrtConnect, RrtStar

PLANNERS: Final[dict[str, Callable[[PlannerConfig], Planner]]] = {
    "astar": GridPlanner,
    "dijkstra": lambda config: GridPlanner(config, guided=False),
    "hybrid": HybridPlanner,
    "rrt": Rrt,
    "rrt-connect": RrtConnect,
    "rrtstar": RrtStar,
}
