"""`PLANNERS`: the ways to plan a path through a known map; one loads when it is made."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Final

from robotctl.planning.behaviours.kind import Paths

if TYPE_CHECKING:
    from robotctl.model.grid_map import GridMap  # numpy, which control must not load

PLANNERS: Final[dict[str, str]] = {
    "a_star": "free_path:a_star",
    "dijkstra": "free_path:dijkstra",
}
"""By the name in `navigation.planner`: module and factory in this folder.

They are named and not imported: the configuration is read by processes that need no numba.
"""


def make_planner(name: str, world_map: GridMap, half_width_m: float) -> Paths:
    """Make a planner of the table.

    Parameters
    ----------
    name
        Of `PLANNERS`.
    world_map
        The map.
    half_width_m
        Of the robot [m], > 0.
    """
    module, _, factory = PLANNERS[name].partition(":")
    found: Any = importlib.import_module(f"{__package__}.{module}")
    planner: Paths = getattr(found, factory)(world_map, half_width_m)
    return planner
