"""Paths over the cells of a map for robots that can turn on the spot: A* and Dijkstra's algorithm.

First a path is looked for on which the robot could turn anywhere; if there is none, a narrower
one, down to where it fits lengthwise. That leads straight through narrow places, where they are
straight. The body is checked at each pose; a cell at which it would touch something is closed, and
the search begins again. Where the body cannot turn at the start or the goal, as close beside a
wall, and no such path is found, one of arcs may lead there; to a goal also where such a path turns
without room for that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.map.planning_map import APART, PlanningMap
from robotctl.planning.path.global_planning.gates import Gate, gated
from robotctl.planning.path.global_planning.grid_search import LETHAL, search_cells
from robotctl.planning.path.global_planning.hybrid_planner import HybridPlanner
from robotctl.planning.path.global_planning.obstructions import blocked_ends, no_path
from robotctl.planning.path.global_planning.plan import (
    GoesOn,
    Plan,
    PlanFailure,
    PlannerConfig,
    Reason,
)
from robotctl.planning.path.global_planning.smoothing import straightened
from robotctl.planning.path.global_planning.straight import collisions, radii, straight_poses
from robotctl.planning.path.global_planning.widest_way import widest_way

_CLASSES: Final = 250
"""Costs between the margin and comfort."""
_TRIES: Final = 20
"""Searches with one circle, each with the piece closed that the body did not pass."""
_TURN_RAD: Final = math.radians(3.0)
"""Turn that a robot makes on its way: as far as headings may be off on arrival."""


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
        failure = blocked_ends(space, start, goal)
        if failure is not None:
            return failure
        side_m = space.grid.resolution_m
        margin = self._config.margin_m / side_m
        expanded, widest = 0, math.inf
        for i, radius in enumerate(radii(space, margin)):
            if radius > widest:
                continue
            found = self._search(space, radius, start, goal, goes_on)
            expanded += found.expanded
            if isinstance(found, PlanFailure):
                return replace(found, expanded=expanded)
            if len(found.poses):
                found = replace(found, expanded=expanded)
                return self._without_a_tight_turn(space, found, start, goal, goes_on)
            # The second circle mostly does; where it does not, few of the others may.
            if i == 1 and self._config.corners == "both":
                widest = _widest(space, start, goal)
        failure = no_path(space, start, goal, expanded)
        ends = space.to_cells(start), space.to_cells(goal)
        near = min(space.clearance[math.floor(end.y_m), math.floor(end.x_m)] for end in ends)
        if failure.reason is not Reason.NOT_FOUND or near >= space.circumscribed + APART:
            return failure
        return HybridPlanner(self._config).plan(space, start, goal, goes_on)

    def _without_a_tight_turn(
        self, space: PlanningMap, found: Plan, start: SE2, goal: SE2, goes_on: GoesOn
    ) -> Plan:
        """Return one of arcs in place of a path that turns where it has no room, near its end."""
        for before, pose in pairwise(found.poses[::-1].tolist()):
            if space.can_turn_at(SE2(*pose), self._config.margin_m):
                return found
            if abs(wrap_angle(before[2] - pose[2])) > _TURN_RAD:
                break
        else:  # it only drives straight on
            return found
        arcs = HybridPlanner(self._config).plan(space, start, goal, goes_on)
        return arcs if isinstance(arcs, Plan) else found

    def _search(
        self, space: PlanningMap, radius: float, start: SE2, goal: SE2, goes_on: GoesOn
    ) -> Plan | PlanFailure:
        """Return a path at a distance [cells] from what is blocked; without poses: none."""
        costs, factors = self._costs(space, radius)
        ends = space.to_cells(start), space.to_cells(goal)
        cells = [(math.floor(end.y_m), math.floor(end.x_m)) for end in ends]
        for end in cells:  # the body fits there, however near to a wall
            costs[end] = min(int(costs[end]), _CLASSES)
        expanded = 0
        for _ in range(_TRIES):
            found = search_cells(
                costs, factors, cells[0], cells[1],
                corners=self._config.corners, guided=self._guided, goes_on=goes_on,
            )  # fmt: skip
            expanded += found.expanded
            if not found.in_time:
                return PlanFailure(Reason.OUT_OF_TIME, "the time was over", None, expanded)
            if not len(found.cells):
                break
            prices = factors[costs]
            gates = list(gated(found.cells, space, self._config.margin_m))
            poses = self._poses(space, found.cells, prices, ends, gates)
            stuck = collisions(space, poses)
            if len(stuck) and gates:
                poses = self._poses(space, found.cells, prices, ends, [])
                stuck = collisions(space, poses)
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
        # Above 1: what a step into the cell costs more than its length, as a share of the most.
        dearer, most = np.zeros(space.shape, np.float32), 0.0
        if comfort > 0.0 and config.comfort_weight > 0.0 and space.circumscribed > 0.0:
            dearer = np.clip(1.0 - room / np.float32(comfort), 0.0, 1.0)
            most = config.comfort_weight
        if space.slowness is not None:
            price = (1.0 + np.float32(most) * dearer) * space.slowness
            most = (1.0 + most) * float(space.slowness.max()) - 1.0
            dearer = (price - 1.0) / np.float32(max(most, 1e-9))
        costs = np.rint(dearer * _CLASSES).astype(np.uint8)
        factors[: _CLASSES + 1] = 1.0 + most * np.arange(_CLASSES + 1) / _CLASSES
        costs[(room < 0.0) | space.blocked] = LETHAL
        return costs, factors

    def _poses(
        self,
        space: PlanningMap,
        cells: NDArray[np.int64],
        prices: NDArray[np.float64],
        ends: tuple[SE2, SE2],
        gates: Sequence[Gate],
    ) -> NDArray[np.float64]:
        """Return the poses of a path, (n, 3) in cells; the last heading is that of the goal."""
        points = (cells[:, ::-1] + 0.5).astype(np.float64)
        if len(points) == 1:
            points = np.repeat(points, 2, axis=0)
        points[0], points[-1] = (ends[0].x_m, ends[0].y_m), (ends[1].x_m, ends[1].y_m)
        begin, pieces = 0, []
        for gate in gates:
            pieces += [self._straightened(points[begin : gate.first + 1], space, prices), gate.ends]
            begin = gate.last
        pieces.append(self._straightened(points[begin:], space, prices))
        return straight_poses(np.concatenate(pieces), *ends)

    def _straightened(
        self, points: NDArray[np.float64], space: PlanningMap, prices: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return a part of a path, of as few points as it may have."""
        if not self._config.any_angle:
            return points
        return points[straightened(points, space.clearance, prices)]


def _widest(space: PlanningMap, start: SE2, goal: SE2) -> float:
    """Return half the width of the widest way between places that have room [cells]; -1: none."""
    here, there = space.to_cells(start), space.to_cells(goal)
    ends = [(math.floor(end.y_m), math.floor(end.x_m)) for end in (here, there)]
    room = space.clearance.copy()
    for end in ends:
        room[end] = math.inf
    way = widest_way(room, *ends)
    return -1.0 if way is None else way[0]
