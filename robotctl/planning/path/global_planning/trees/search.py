"""Space in which random trees grow: for a robot that turns on the spot, and for one that steers.

A tree of straight pieces sees the robot as a circle: that around its body, or where no way is wide
enough for it, the one inside; then the body is checked along the path. On a curve the body itself
is checked: first it keeps the margin; if there is no such path, it only must not touch anything.
"""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.se2 import SE2
from robotctl.planning.map.planning_map import PlanningMap, body_hits
from robotctl.planning.path.global_planning.plan import Plan, PlannerConfig
from robotctl.planning.path.global_planning.straight import collisions, radii, straight_poses
from robotctl.planning.path.global_planning.trees.motions import (
    BOTH,
    FORWARD,
    STRAIGHT,
    Course,
    curve_between,
    drive,
)
from robotctl.planning.path.global_planning.trees.point_paths import price_along, rejoin, shorten
from robotctl.planning.path.global_planning.trees.pose_paths import (
    PosePath,
    cost_along,
    path_from_root,
    shorten_poses,
)
from robotctl.planning.path.global_planning.trees.sampling import cells_around, narrow_cells
from robotctl.planning.path.global_planning.trees.tree import (
    Tree,
    add_pose,
    add_poses,
    branch,
    make_tree,
)

_SHORTENINGS: Final = 400
_NEIGHBOURS: Final = 30
"""Maximum neighbours of a point when the shortest path over all points is searched."""
_LEAST_REACH: Final = 8.0
"""Minimum distance of those [cells]."""


class TreeSearch(ABC):
    """Common base of the spaces in which trees grow: lengths in cells.

    Parameters
    ----------
    space, ends
        The map, and start and goal in `world`.
    seed
        Seed count of the samples.
    steering, radius, clearance, circle
        As `Course` has them.
    priced
        Whether slow zones count.

    Attributes
    ----------
    may_succeed
        Whether the circle can pass from the start to the goal.
    expanded
        Poses of all trees so far.
    """

    capacity: ClassVar[int]
    """Maximum poses of a tree."""
    rounds: ClassVar[int]
    """Rounds between two checks of the time limit: a few milliseconds."""
    samples: ClassVar[float]
    """Maximum samples for a first path."""
    improvements: ClassVar[int]
    """Maximum samples of RRT* once a path is known."""
    tries: ClassVar[int]
    """Maximum number of trees."""

    def __init__(
        self,
        space: PlanningMap,
        ends: tuple[SE2, SE2],
        seed: int,
        steering: int,
        radius: float,
        clearance: NDArray[np.float32],
        circle: float,
        *,
        priced: bool,
    ) -> None:
        self._space = space
        self._ends = space.to_cells(ends[0]), space.to_cells(ends[1])
        has_heading = steering != STRAIGHT
        self.start, self.goal = (
            np.array([end.x_m, end.y_m, end.theta_rad * has_heading]) for end in self._ends
        )
        self.rng = np.random.default_rng(seed)
        self.expanded = 0
        (x, y, _), (goal_x, goal_y, _) = self.start, self.goal
        reached, free = cells_around(clearance, circle, math.floor(y), math.floor(x))
        self.may_succeed = bool(reached[math.floor(goal_y), math.floor(goal_x)])
        prices = np.empty((0, 0))
        if priced and space.slowness is not None:
            prices = space.slowness.astype(np.float64)
        self.course = Course(
            steering, radius, space.blocked | (clearance < 0.0), clearance, circle,
            space.samples, space.discs, prices, free, narrow_cells(reached),
        )  # fmt: skip

    def tree(self, root: NDArray[np.float64]) -> Tree:
        """Return a tree that begins at a pose."""
        return make_tree(self.course.blocked.shape, self.capacity, root, self.course.steering)

    def direct(self) -> PosePath | None:
        """Return the path without a turn between start and goal, if it is free."""
        course = self.course
        curve = curve_between(self.start, self.goal, course.radius, course.steering)
        is_free, cost = drive(course, self.start, curve, self.goal)
        if not is_free:
            return None
        tree = make_tree(course.blocked.shape, 2, self.start, course.steering)
        return self.path(tree, add_pose(tree, self.goal, 0, curve, cost))

    @abstractmethod
    def path(self, tree: Tree, node: int) -> PosePath:
        """Return the path from the root of a tree to one of its poses."""

    @abstractmethod
    def shortest(self, path: PosePath, *trees: Tree) -> PosePath:
        """Return a path that is shorter than one over trees, by other poses of theirs."""

    @abstractmethod
    def plan(self, path: PosePath) -> Plan | None:
        """Return a path in `world`, as short as can be; None: the body cannot take it."""


class StraightSearch(TreeSearch):
    """Space of a robot that turns on the spot; `room` is the radius of the circle [cells]."""

    capacity = 200_000  # 24 MB, most of which is never touched
    rounds = 1000
    samples = math.inf
    improvements = 20_000
    tries = 30

    def __init__(
        self,
        space: PlanningMap,
        room: float,
        ends: tuple[SE2, SE2],
        config: PlannerConfig,
        *,
        priced: bool,
    ) -> None:
        super().__init__(
            space, ends, config.seed, STRAIGHT, 1.0, space.clearance, room, priced=priced
        )

    @staticmethod
    def rooms(space: PlanningMap, config: PlannerConfig) -> list[float]:
        """Return the rooms to search, the widest first."""
        return radii(space, config.margin_m / space.grid.resolution_m)

    def path(self, tree: Tree, node: int) -> PosePath:
        """Return the points from the root to one of a tree."""
        chain = branch(tree, node)
        return PosePath(tree.pose[chain], np.ones(len(chain), np.int64))

    def shortest(self, path: PosePath, *trees: Tree) -> PosePath:
        """Return the shortest path over all points of the trees and those along a path."""
        points = np.vstack([tree.pose[: tree.size[0]] for tree in trees])
        per_point = len(self.course.free) / len(points)
        reach = max(math.sqrt(_NEIGHBOURS * per_point / math.pi), _LEAST_REACH)
        way = _dense(path.poses, 0.9 * reach)
        points = np.vstack([way, points])
        joined = make_tree(self.course.blocked.shape, len(points), self.start, STRAIGHT)
        add_poses(joined, points[1:])
        found = rejoin(joined, self.course.clearance, self.course.circle, len(way) - 1, reach)
        return PosePath(points[found], np.ones(len(found), np.int64)) if len(found) else path

    def plan(self, path: PosePath) -> Plan | None:
        """Return the shortened path, if the body can take it."""
        clearance, circle, prices = self.course.clearance, self.course.circle, self.course.prices
        points = shorten(path.poses[:, :2], clearance, circle, prices, self.rng, _SHORTENINGS)
        poses = straight_poses(points, *self._ends)
        if len(collisions(self._space, poses)):
            return None
        cost_m = float(price_along(points, prices)) * self._space.grid.resolution_m
        return Plan(self._space.to_world(poses), cost_m, self.expanded)


class CurvedSearch(TreeSearch):
    """Space of a robot that steers; `room` is the margin around its body [cells]."""

    capacity = 50_000  # 7 MB
    rounds = 100
    samples = 20_000
    improvements = 4000
    tries = 1

    def __init__(
        self,
        space: PlanningMap,
        room: float,
        ends: tuple[SE2, SE2],
        config: PlannerConfig,
        *,
        priced: bool,
    ) -> None:
        super().__init__(
            space,
            ends,
            config.seed,
            FORWARD if config.steering == "dubins" else BOTH,
            config.turning_radius_m / space.grid.resolution_m,
            space.clearance - np.float32(room),
            # With less room, no robot of any heading fits, wherever it is in a cell.
            max(space.inscribed - math.sqrt(0.5), 0.0),
            priced=priced,
        )
        self.may_succeed = self.may_succeed and not self._collides()

    @staticmethod
    def rooms(space: PlanningMap, config: PlannerConfig) -> list[float]:
        """Return the rooms to search, the widest first."""
        return list(dict.fromkeys((config.margin_m / space.grid.resolution_m, 0.0)))

    def _collides(self) -> bool:
        """Return whether the body touches something at an end."""
        course = self.course
        return any(
            body_hits(course.blocked, course.clearance, course.samples, course.discs, *end)
            for end in (self.start, self.goal)
        )

    def path(self, tree: Tree, node: int) -> PosePath:
        """Return the poses along the curves from the root to one of a tree."""
        return path_from_root(tree, node, self.course.radius)

    def shortest(self, path: PosePath, *trees: Tree) -> PosePath:  # noqa: ARG002
        """Return the same path: other curves between the poses of trees would hardly join."""
        return path

    def plan(self, path: PosePath) -> Plan | None:
        """Return the path with cheaper curves in place of others."""
        better = PosePath(*shorten_poses(*path, self.course, self.rng, _SHORTENINGS))
        cost_m = float(cost_along(*better, self.course.prices)[-1])
        cost_m *= self._space.grid.resolution_m
        poses = self._space.to_world(better.poses)
        return Plan(poses, cost_m, self.expanded, better.gears[1:] < 0)


def _dense(path: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """Return the poses of a path (n, 3) with others between them, at most so far apart."""
    dense = [path[:1]]
    for a, b in itertools.pairwise(path):
        count = max(1, math.ceil(math.dist(a[:2], b[:2]) / spacing))
        dense.append(a + np.linspace(0.0, 1.0, count + 1)[1:, np.newaxis] * (b - a))
    return np.concatenate(dense)
