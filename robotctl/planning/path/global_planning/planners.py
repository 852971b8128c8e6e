"""The registry of global planners: one line makes a planner one of `robotctl plan`'s."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from robotctl.planning.path.global_planning.grid_planner import GridPlanner
from robotctl.planning.path.global_planning.hybrid_planner import HybridPlanner
from robotctl.planning.path.global_planning.plan import Planner, PlannerConfig
from robotctl.planning.path.global_planning.trees.planner import TreePlanner

PLANNERS: Final[dict[str, Callable[[PlannerConfig], Planner]]] = {
    "astar": GridPlanner,
    "dijkstra": lambda config: GridPlanner(config, guided=False),
    "hybrid": HybridPlanner,
    "rrt": lambda config: TreePlanner("rrt", config),
    "rrt-connect": lambda config: TreePlanner("rrt-connect", config),
    "rrtstar": lambda config: TreePlanner("rrtstar", config),
}
