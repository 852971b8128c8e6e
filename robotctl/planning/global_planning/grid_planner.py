"""Paths over the cells of a map for robots that can turn on the spot: A* and Dijkstra's algorithm.

First a path is looked for on which the robot could turn anywhere; where there is none, one through
which it fits lengthwise, and there its body is checked at each pose. A piece that the body would
not pass is closed, and the search begins again.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.costmap.cost_map import LETHAL
from robotctl.planning.costmap.planning_map import PlanningMap
from robotctl.planning.global_planning.grid_search import CellPath, search_cells
from robotctl.planning.global_planning.obstructions import blocked_end, no_path
from robotctl.planning.global_planning.plan import (
    GoesOn,
    Plan,
    PlanFailure,
    PlannerConfig,
    Reason,
)
from robotctl.planning.global_planning.smoothing import straightened

_CLASSES: Final = 250
"""Costs between the margin and comfort."""
_TRIES: Final = 40
"""Searches of a narrow path, each with the piece closed that the body did not pass."""
_TURN_RAD: Final = math.radians(5.0)
"""Between two poses at which the body is checked as it turns."""


class GridPlanner:
    """A* over the cells, or Dijkstra's algorithm; the path is straightened.

    Parameters
    ----------
    config
        How paths are chosen.
    guided
        A*; else Dijkstra's algorithm.
    """

    def __init__(self, config: PlannerConfig | None = None, *, guided: bool = True) -> None:
        self._config = config or PlannerConfig()
        self._guided = guided

    def plan(
        self, space: PlanningMap, start: SE2, goal: SE2, goes_on: GoesOn = lambda: True
    ) -> Plan | PlanFailure:
        """Return the cheapest path, or why there is none."""
        for name, pose in (("start", start), ("goal", goal)):
            failure = blocked_end(space, name, pose)
            if failure is not None:
                return failure
        side_m = space.grid.resolution_m
        margin = self._config.margin_m / side_m
        expanded = 0
        # In a passage an even number of cells wide, the middle lies between two cells.
        narrow = max(space.inscribed - 0.5, 0.0)
        for radius in dict.fromkeys((space.circumscribed + margin, narrow)):
            found = self._search(space, radius, start, goal, goes_on)
            expanded += found.expanded
            if isinstance(found, PlanFailure):
                return replace(found, expanded=expanded)
            if len(found.poses):
                return replace(found, expanded=expanded)
        return no_path(space, start, goal, expanded)

    def _search(
        self, space: PlanningMap, radius: float, start: SE2, goal: SE2, goes_on: GoesOn
    ) -> Plan | PlanFailure:
        """Return a path at a distance [cells] from what is blocked; without poses: none."""
        costs, factors = self._costs(space, radius)
        turns = radius >= space.circumscribed
        ends = space.to_cells(start), space.to_cells(goal)
        cells = [(math.floor(end.y_m), math.floor(end.x_m)) for end in ends]
        for end in cells:  # the body fits there, however near to a wall
            costs[end] = min(int(costs[end]), _CLASSES)
        expanded = 0
        for _ in range(1 if turns else _TRIES):
            found = search_cells(
                costs, factors, cells[0], cells[1],
                corners=self._config.corners, guided=self._guided, goes_on=goes_on,
            )  # fmt: skip
            expanded += found.expanded
            if not found.in_time:
                return PlanFailure(Reason.OUT_OF_TIME, "the time was over", None, expanded)
            if not len(found.cells):
                break
            poses = self._poses(space, found, costs, factors, ends)
            stuck = _collisions(space, poses)
            if not len(stuck):
                cost_m = found.cost * space.grid.resolution_m
                return Plan(space.to_world(poses), cost_m, expanded)
            columns, rows = np.floor(stuck).astype(np.int64).T
            costs[rows, columns] = LETHAL
            if LETHAL in (costs[cells[0]], costs[cells[1]]):
                break
        return Plan(np.empty((0, 3)), math.inf, expanded)

    def _costs(
        self, space: PlanningMap, radius: float
    ) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
        """Return a class of cost for each cell, and what a step into each class costs."""
        config, side_m = self._config, space.grid.resolution_m
        room = space.clearance - np.float32(radius)
        comfort = config.comfort_m / side_m
        factors = np.full(256, math.inf)
        if comfort > 0.0 and config.comfort_weight > 0.0 and space.circumscribed > 0.0:
            near = np.clip(1.0 - room / np.float32(comfort), 0.0, 1.0)
            costs = np.rint(near * _CLASSES).astype(np.uint8)
            share = np.arange(_CLASSES + 1) / _CLASSES
            factors[: _CLASSES + 1] = 1.0 + config.comfort_weight * share
        else:
            costs = np.zeros(space.shape, np.uint8)
            factors[: _CLASSES + 1] = 1.0
        costs[(room < 0.0) | space.blocked] = LETHAL
        return costs, factors

    def _poses(
        self,
        space: PlanningMap,
        found: CellPath,
        costs: NDArray[np.uint8],
        factors: NDArray[np.float64],
        ends: tuple[SE2, SE2],
    ) -> NDArray[np.float64]:
        """Return the poses of a path, (n, 3) in cells; the last heading is that of the goal."""
        cells = found.cells
        if self._config.any_angle:
            prices = factors[costs]
            cells = cells[straightened(cells, space.clearance, prices)]
        inner = cells[1:-1, ::-1] + 0.5
        points = np.array([(ends[0].x_m, ends[0].y_m), *inner, (ends[1].x_m, ends[1].y_m)])
        steps = np.diff(points, axis=0)
        headings = np.append(np.arctan2(steps[:, 1], steps[:, 0]), ends[1].theta_rad)
        poses = np.column_stack([points, headings])
        # The robot turns on the spot to its first piece, and from the last one to the goal.
        first = np.array([[ends[0].x_m, ends[0].y_m, ends[0].theta_rad]])
        return _with_turns(first, poses)


def _with_turns(first: NDArray[np.float64], poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return poses between which the robot either drives straight or turns on the spot."""
    arrivals = poses[1:].copy()
    arrivals[:, 2] = poses[:-1, 2]
    both = np.empty((2 * len(poses) - 2, 3))
    both[0::2], both[1::2] = poses[:-1], arrivals
    return np.concatenate([first, both, poses[-1:]])


def _collisions(space: PlanningMap, poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where `base` is as its body first touches something, of each piece, (k, 2) [cells]."""
    stuck = []
    for a, b in itertools.pairwise(poses):
        turn = wrap_angle(b[2] - a[2])
        count = 1 + int(max(2.0 * math.dist(a[:2], b[:2]), abs(turn) / _TURN_RAD))
        share = np.linspace(0.0, 1.0, count + 1)[:, np.newaxis]
        between = a + share * np.array([b[0] - a[0], b[1] - a[1], turn])
        hits = space.collides(between)
        if hits.any():
            stuck.append(between[int(np.argmax(hits)), :2])
    return np.array(stuck).reshape(-1, 2)
