"""The registry of global planners: one line makes a planner one of `robotctl plan`'s."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from robotctl.model.drives.drives import Drive
from robotctl.model.footprint import Footprint
from robotctl.planning.config import PilotConfig
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


def planner_of(pilot: PilotConfig, drive: Drive) -> str:
    """Return the name of the planner by which a robot drives."""
    return pilot.planner or ("hybrid" if drive.steered else "astar")


def planner_config(
    pilot: PilotConfig, drive: Drive, footprint: Footprint, turning_radius_m: float
) -> PlannerConfig:
    """Return how paths of a robot are chosen; one that turns on the spot may have no radius [m]."""
    return PlannerConfig(
        margin_m=pilot.margin_m,
        comfort_m=pilot.comfort_m,
        comfort_weight=pilot.comfort_weight,
        turning_radius_m=turning_radius_m or 2.0 * footprint.inscribed_m,
        steering="reeds-shepp" if drive.steered else "straight",
    )
