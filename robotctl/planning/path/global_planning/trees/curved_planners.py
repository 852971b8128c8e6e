"""RRT, RRT-Connect and informed RRT* for robots that steer: trees of poses, joined by curves.

Every motion is a Reeds-Shepp curve, or a Dubins curve for a robot that must not reverse, on which
the robot's body was checked. First the body keeps the margin; if there is no such path, it only
must not touch anything. The same seed gives the same path.
"""

from __future__ import annotations

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
from robotctl.planning.path.global_planning.trees.motions import (
    BOTH,
    FORWARD,
    Course,
    curve_between,
    drive_along,
    length_of,
)
from robotctl.planning.path.global_planning.trees.point_tree import FOUND, FULL, GOING_ON
from robotctl.planning.path.global_planning.trees.pose_growth import (
    grow_cheapest,
    grow_pose_trees,
    grow_to_goal,
)
from robotctl.planning.path.global_planning.trees.pose_paths import (
    PosePath,
    backwards,
    cost_along,
    joined,
    path_from_root,
    shorten_poses,
)
from robotctl.planning.path.global_planning.trees.pose_tree import (
    PoseTree,
    add_pose,
    cost_of,
    make_pose_tree,
)
from robotctl.planning.path.global_planning.trees.sampling import cells_around, narrow_cells

_CAPACITY: Final = 50_000
"""Poses of a tree at most: 8 MB."""
_ROUNDS: Final = 100
"""Rounds between two checks of the time limit: a few milliseconds."""
_SAMPLES: Final = 20_000
"""Maximum samples for a first path."""
_OPTIMAL_SAMPLES: Final = 4000
"""Maximum samples of RRT* once a path is known."""
_BUCKET: Final = 8.0
"""Side of a bucket [cells]."""
_LONGEST: Final = 60.0
"""A tree grows by this at most [cells]: 3 m at 5 cm."""
_CHORDS: Final = 0.1
"""A path that costs so much more than its length is the cheapest [cells]: costs are of chords."""
_SHORTENINGS: Final = 400


class CurvedTreePlanner(ABC):
    """Common base of the planners by random trees of poses.

    Parameters
    ----------
    config
        Steering, turning radius, margin and seed count.
    """

    _priced: ClassVar[bool] = False
    """Whether slow zones count."""

    def __init__(self, config: PlannerConfig) -> None:
        self._config = config

    def plan(
        self, space: PlanningMap, start: SE2, goal: SE2, goes_on: GoesOn = lambda: True
    ) -> Plan | PlanFailure:
        """Return a path that the robot can drive, or why there is none."""
        failure = blocked_ends(space, start, goal)
        if failure is not None:
            return failure
        side_m = space.grid.resolution_m
        expanded = 0
        for margin in dict.fromkeys((self._config.margin_m / side_m, 0.0)):
            search = _CurveSearch(space, margin, (start, goal), self._config, priced=self._priced)
            if not search.may_succeed:
                continue
            path = self._grow(search, goes_on)
            expanded += search.expanded
            if path is not None:
                path, cost = search.shortened(path)
                reverse = path.gears[1:] < 0
                return Plan(space.to_world(path.poses), cost * side_m, expanded, reverse)
            if not goes_on():
                return PlanFailure(Reason.OUT_OF_TIME, "the time was over", None, expanded)
        return no_path(space, start, goal, expanded)

    @abstractmethod
    def _grow(self, search: _CurveSearch, goes_on: GoesOn) -> PosePath | None:
        """Return a path, or None."""


class _CurveSearch:
    """The space in which a tree of poses grows."""

    def __init__(
        self,
        space: PlanningMap,
        margin: float,
        ends: tuple[SE2, SE2],
        config: PlannerConfig,
        *,
        priced: bool,
    ) -> None:
        self.start, self.goal = (
            np.array([end.x_m, end.y_m, end.theta_rad]) for end in map(space.to_cells, ends)
        )
        self.gears = FORWARD if config.steering == "dubins" else BOTH
        self.radius = config.turning_radius_m / space.grid.resolution_m
        clearance = space.clearance - np.float32(margin)
        prices = space.zone_prices() if priced else np.ones(space.shape, np.float32)
        self.course = Course(
            space.blocked | (clearance < 0.0), clearance, prices,
            space.samples, space.discs, self.radius,
        )  # fmt: skip
        self.rng = np.random.default_rng(config.seed)
        self.expanded = 0
        # With less room, no robot of any heading fits, wherever it is in a cell.
        least = max(space.inscribed - math.sqrt(0.5), 0.0)
        (x, y, _), (goal_x, goal_y, _) = self.start, self.goal
        reached, self.free = cells_around(clearance, least, math.floor(y), math.floor(x))
        is_joined = bool(reached[math.floor(goal_y), math.floor(goal_x)])
        self.may_succeed = is_joined and not self._collides()
        """Whether the body can stand at both ends, and a circle inside of it can pass."""
        self.narrow = narrow_cells(reached)

    def _collides(self) -> bool:
        """Return whether the body touches something at an end."""
        stays = np.zeros((2, 5))
        stays[1, 0] = 1e-6
        course = self.course
        return any(drive_along(course, end, stays, 1.0)[0] < 1.0 for end in (self.start, self.goal))

    def tree(self, root: NDArray[np.float64]) -> PoseTree:
        """Return a tree that begins at a pose."""
        return make_pose_tree(self.course.blocked.shape, _CAPACITY, _BUCKET, root)

    def direct(self) -> PosePath | None:
        """Return the curve from the start to the goal, if it is free."""
        curve = curve_between(self.start, self.goal, self.radius, self.gears)
        way, cost = drive_along(self.course, self.start, curve, math.inf)
        if way < math.inf:
            return None
        tree = make_pose_tree((1, 1), 2, math.inf, self.start)
        return path_from_root(tree, add_pose(tree, self.goal, 0, curve, cost), self.radius)

    def shortened(self, path: PosePath) -> tuple[PosePath, float]:
        """Return a path that costs no more, and its cost [cells]."""
        better = PosePath(*shorten_poses(*path, self.course, self.gears, self.rng, _SHORTENINGS))
        return better, float(cost_along(*better, self.course.prices)[-1])


class CurvedRrt(CurvedTreePlanner):
    """One tree from the start, until a curve from it leads to the goal."""

    def _grow(self, search: _CurveSearch, goes_on: GoesOn) -> PosePath | None:
        if (path := search.direct()) is not None:
            return path
        tree = search.tree(search.start)
        status, node, left = GOING_ON, -1, _SAMPLES
        while status == GOING_ON and left > 0 and goes_on():
            status, node = grow_to_goal(
                tree, search.course, search.goal, search.gears,
                search.free, search.narrow, search.rng, _LONGEST, _ROUNDS,
            )  # fmt: skip
            left -= _ROUNDS
        search.expanded += int(tree.size[0])
        return path_from_root(tree, node, search.radius) if status == FOUND else None


class CurvedRrtConnect(CurvedTreePlanner):
    """Two trees, from start and goal, that grow to each other."""

    def _grow(self, search: _CurveSearch, goes_on: GoesOn) -> PosePath | None:
        if (path := search.direct()) is not None:
            return path
        trees = search.tree(search.start), search.tree(search.goal)
        status, one, other, left = GOING_ON, -1, -1, _SAMPLES
        while status == GOING_ON and left > 0 and goes_on():
            status, one, other = grow_pose_trees(
                trees, search.course, search.gears,
                search.free, search.narrow, search.rng, _LONGEST, _ROUNDS,
            )  # fmt: skip
            left -= _ROUNDS
        search.expanded += int(trees[0].size[0] + trees[1].size[0])
        if status != FOUND:
            return None
        first, second = (
            path_from_root(tree, node, search.radius)
            for tree, node in zip(trees, (one, other), strict=True)
        )
        return joined(first, backwards(second))


class CurvedRrtStar(CurvedTreePlanner):
    """One tree whose paths become cheaper as it grows: RRT*, with informed samples."""

    _priced = True

    def _grow(self, search: _CurveSearch, goes_on: GoesOn) -> PosePath | None:
        tree = search.tree(search.start)
        shortest = length_of(
            curve_between(search.start, search.goal, search.radius, search.gears), search.radius
        )
        status, at_goal, left = GOING_ON, -1, _SAMPLES
        while status != FULL and left > 0 and goes_on():
            status, node = grow_cheapest(
                tree, search.course, search.goal, search.gears,
                search.free, search.narrow, search.rng, _LONGEST, at_goal, _ROUNDS,
            )  # fmt: skip
            left = _OPTIMAL_SAMPLES if at_goal < 0 <= node else left - _ROUNDS
            at_goal = node
            if at_goal >= 0 and cost_of(tree, at_goal) <= shortest + _CHORDS:
                break
        search.expanded += int(tree.size[0])
        return path_from_root(tree, at_goal, search.radius) if at_goal >= 0 else None
