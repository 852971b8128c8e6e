"""The registry of global planners: one line makes a planner one of `robotctl plan`'s."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeAlias

from robotctl.planning.path.global_planning.grid_planner import GridPlanner
from robotctl.planning.path.global_planning.hybrid_planner import HybridPlanner
from robotctl.planning.path.global_planning.plan import Planner, PlannerConfig
from robotctl.planning.path.global_planning.trees.curved_planners import (
    CurvedRrt,
    CurvedRrtConnect,
    CurvedRrtStar,
)
from robotctl.planning.path.global_planning.trees.straight_planners import Rrt, RrtConnect, RrtStar

_Make: TypeAlias = Callable[[PlannerConfig], Planner]


def _by_steering(straight: _Make, curved: _Make) -> _Make:
    """Return what makes one planner for straight pieces, and another for curves."""
    return lambda config: (straight if config.steering == "straight" else curved)(config)


PLANNERS: Final[dict[str, _Make]] = {
    "astar": GridPlanner,
    "dijkstra": lambda config: GridPlanner(config, guided=False),
    "hybrid": HybridPlanner,
    "rrt": _by_steering(Rrt, CurvedRrt),
    "rrt-connect": _by_steering(RrtConnect, CurvedRrtConnect),
    "rrtstar": _by_steering(RrtStar, CurvedRrtStar),
}
