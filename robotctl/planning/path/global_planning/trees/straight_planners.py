"""RRT, RRT-Connect and informed RRT* for robots that can turn on the spot.

A tree sees the robot as a circle: that around its body, or where no way is wide enough for it, the
one inside; then the body is checked along the path. Half of the samples come from passages that
are narrow, which uniform samples hardly ever hit. The same seed gives the same path.
"""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.se2 import SE2
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.path.global_planning.obstructions import blocked_ends, no_path
from robotctl.planning.path.global_planning.plan import (
    GoesOn,
    Plan,
    PlanFailure,
    PlannerConfig,
    Reason,
)
from robotctl.planning.path.global_planning.straight import collisions, radii, straight_poses
from robotctl.planning.path.global_planning.trees.optimal_growth import grow_optimal
from robotctl.planning.path.global_planning.trees.point_paths import price_along, rejoin, shorten
from robotctl.planning.path.global_planning.trees.point_tree import (
    FOUND,
    FULL,
    GOING_ON,
    Tree,
    add_points,
    branch,
    free_share,
    grow_both,
    grow_single,
    make_tree,
    price_of,
)
from robotctl.planning.path.global_planning.trees.sampling import cells_around, narrow_cells

Point = tuple[float, float]

_CAPACITY: Final = 200_000
"""Points of a tree at most: 6 MB."""
_ROUNDS: Final = 1000
"""Rounds between two checks of the time limit: a few milliseconds."""
_BUCKET: Final = 8.0
"""Side of a bucket [cells]."""
_LONGEST: Final = 60.0
"""A tree grows by this at most [cells]: 3 m at 5 cm."""
_OPTIMAL_ROUNDS: Final = 20_000
"""Maximum rounds of RRT* once a path is known."""
_NEIGHBOURS: Final = 30
"""Maximum neighbours of a point when the shortest path over all points is searched."""
_SHORTENINGS: Final = 400
_TRIES: Final = 30
"""Trees with one circle: the body may not pass on the path of the first."""


class TreePlanner(ABC):
    """Common base of the planners by random trees.

    Parameters
    ----------
    config
        Margin and seed count.
    """

    _priced: ClassVar[bool] = False
    """Whether slow zones count."""

    def __init__(self, config: PlannerConfig | None = None) -> None:
        self._config = config or PlannerConfig()

    def plan(
        self, space: PlanningMap, start: SE2, goal: SE2, goes_on: GoesOn = lambda: True
    ) -> Plan | PlanFailure:
        """Return a path, or why there is none."""
        failure = blocked_ends(space, start, goal)
        if failure is not None:
            return failure
        ends = space.to_cells(start), space.to_cells(goal)
        side_m = space.grid.resolution_m
        margin = self._config.margin_m / side_m
        expanded = 0
        for radius in radii(space, margin):
            search = _Search(space, radius, ends, self._config.seed, priced=self._priced)
            for _ in range(_TRIES if search.may_succeed else 0):
                path = self._grow(search, goes_on)
                if path is None:
                    break
                path = shorten(
                    path, space.clearance, radius, search.prices, search.rng, _SHORTENINGS
                )
                poses = straight_poses(path, *ends)
                if not len(collisions(space, poses)):
                    cost_m = float(price_along(path, search.prices)) * side_m
                    return Plan(space.to_world(poses), cost_m, expanded + search.expanded)
            if not goes_on():
                expanded += search.expanded
                return PlanFailure(Reason.OUT_OF_TIME, "the time was over", None, expanded)
            expanded += search.expanded
        if expanded:
            text = "there is a way, but the trees did not find one that the body can take"
            return PlanFailure(Reason.NOT_FOUND, text, None, expanded)
        return no_path(space, start, goal, expanded)

    @abstractmethod
    def _grow(self, search: _Search, goes_on: GoesOn) -> NDArray[np.float64] | None:
        """Return the points of a path, (n, 2) in cells, or None."""


class _Search:
    """The space in which a tree grows."""

    def __init__(
        self,
        space: PlanningMap,
        radius: float,
        ends: tuple[SE2, SE2],
        seed: int,
        *,
        priced: bool,
    ) -> None:
        clearance = self.clearance = space.clearance
        self.radius = radius
        self.prices = np.empty((0, 0))
        """As `price_of` takes them."""
        if priced and space.slowness is not None:
            self.prices = space.slowness.astype(np.float64)
        self.start, self.goal = ((end.x_m, end.y_m) for end in ends)
        self.rng = np.random.default_rng(seed)
        self.expanded = 0
        (x, y), (goal_x, goal_y) = self.start, self.goal
        reached, self.free = cells_around(clearance, radius, math.floor(y), math.floor(x))
        self.may_succeed = bool(reached[math.floor(goal_y), math.floor(goal_x)])
        """Whether a circle can pass from the start to the goal."""
        self.narrow = narrow_cells(reached)

    def tree(self, root: Point) -> Tree:
        """Return a tree that begins at a point."""
        return make_tree(self.clearance.shape, _CAPACITY, _BUCKET, root)

    def shortest(self, path: NDArray[np.float64], *trees: Tree) -> NDArray[np.float64]:
        """Return the shortest path over all points of the trees and those along a path."""
        points = np.vstack([tree.xy[: tree.size[0]] for tree in trees])
        per_point = len(self.free) / len(points)
        reach = max(math.sqrt(_NEIGHBOURS * per_point / math.pi), _BUCKET)
        way = _dense(path, 0.9 * reach)
        points = np.vstack([way, points])
        joined = make_tree(self.clearance.shape, len(points), _BUCKET, self.start)
        add_points(joined, _BUCKET, points[1:])
        found = rejoin(joined, _BUCKET, self.clearance, self.radius, len(way) - 1, reach)
        return points[found] if len(found) else path

    def sees(self, a: Point, b: Point) -> bool:
        """Return whether the straight piece between two points is free."""
        return bool(free_share(self.clearance, self.radius, *a, *b) >= 1.0)


class Rrt(TreePlanner):
    """One tree from the start, until it sees the goal; then the shortest path over its points."""

    def _grow(self, search: _Search, goes_on: GoesOn) -> NDArray[np.float64] | None:
        if search.sees(search.start, search.goal):
            return np.array([search.start, search.goal])
        tree = search.tree(search.start)
        status, node = GOING_ON, -1
        while status not in (FOUND, FULL) and goes_on():
            status, node = grow_single(
                tree, _BUCKET, search.clearance, search.radius, search.goal,
                search.free, search.narrow, search.rng, _LONGEST, _ROUNDS,
            )  # fmt: skip
        search.expanded += int(tree.size[0])
        if status != FOUND:
            return None
        return search.shortest(np.vstack([branch(tree, node), search.goal]), tree)


class RrtConnect(TreePlanner):
    """Two trees, from start and goal, that grow to each other; then the same."""

    def _grow(self, search: _Search, goes_on: GoesOn) -> NDArray[np.float64] | None:
        if search.sees(search.start, search.goal):
            return np.array([search.start, search.goal])
        trees = search.tree(search.start), search.tree(search.goal)
        status, one, other = GOING_ON, -1, -1
        while status not in (FOUND, FULL) and goes_on():
            status, one, other = grow_both(
                trees, _BUCKET, search.clearance, search.radius,
                search.free, search.narrow, search.rng, _LONGEST, _ROUNDS,
            )  # fmt: skip
        search.expanded += int(trees[0].size[0] + trees[1].size[0])
        if status != FOUND:
            return None
        path = np.vstack([branch(trees[0], one), branch(trees[1], other)[::-1]])
        return search.shortest(path, *trees)


class RrtStar(TreePlanner):
    """One tree whose paths become cheaper as it grows: RRT*, with informed samples."""

    _priced = True

    def _grow(self, search: _Search, goes_on: GoesOn) -> NDArray[np.float64] | None:
        ends = (*search.start, *search.goal)
        best = math.inf
        if search.sees(search.start, search.goal):
            best = price_of(search.prices, *ends)
            if best <= math.dist(search.start, search.goal) + 1e-9:
                return np.array([search.start, search.goal])
        tree = search.tree(search.start)
        seen, rest = np.zeros(4096, np.int32), np.zeros(4096)
        if best < math.inf:
            seen[0], rest[1] = 1, best  # over point 0, the start
        status, left = GOING_ON, _OPTIMAL_ROUNDS
        while status != FULL and left > 0 and goes_on():
            status, best = grow_optimal(
                tree, _BUCKET, search.clearance, search.radius, ends, search.free, search.narrow,
                search.rng, _LONGEST, search.prices, best, seen, rest, _ROUNDS,
            )  # fmt: skip
            left -= _ROUNDS if best < math.inf else 0
        search.expanded += int(tree.size[0])
        if best == math.inf:
            return None
        nodes = seen[1 : seen[0] + 1]
        node = int(nodes[np.argmin(tree.cost[nodes] + rest[1 : seen[0] + 1])])
        return np.vstack([branch(tree, node), search.goal])


def _dense(path: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """Return the points of a path (n, 2) with others between them, at most so far apart."""
    dense = [path[:1]]
    for a, b in itertools.pairwise(path):
        count = max(1, math.ceil(math.dist(a, b) / spacing))
        dense.append(a + np.linspace(0.0, 1.0, count + 1)[1:, np.newaxis] * (b - a))
    return np.concatenate(dense)
