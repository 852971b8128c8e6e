"""RRT, RRT-Connect and informed RRT*: one planner by random trees, for each kind of steering.

Many of the samples come from passages that are narrow, which uniform samples hardly ever hit. The
same seed gives the same path.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final, Literal, TypeAlias

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
from robotctl.planning.path.global_planning.trees.growth import (
    FOUND,
    FULL,
    GOING_ON,
    grow_both,
    grow_cheapest,
    grow_to_goal,
    reach_goal,
)
from robotctl.planning.path.global_planning.trees.motions import curve_between, length_of
from robotctl.planning.path.global_planning.trees.pose_paths import PosePath, backwards, joined
from robotctl.planning.path.global_planning.trees.search import (
    CurvedSearch,
    StraightSearch,
    TreeSearch,
)

Kind: TypeAlias = Literal["rrt", "rrt-connect", "rrtstar"]

_LONGEST: Final = 60.0
"""A tree grows by this at most [cells]: 3 m at 5 cm."""
_CHORDS: Final = 0.1
"""A path that costs so much more than its length is the cheapest [cells]: costs are of chords."""


class TreePlanner:
    """Planner by random trees.

    Parameters
    ----------
    kind
        One tree from the start until it sees the goal, two trees that grow to each other, or one
        whose paths become cheaper as it grows; only that one considers slow zones.
    config
        Steering, turning radius, margin and seed count.
    """

    def __init__(self, kind: Kind, config: PlannerConfig) -> None:
        self._kind = kind
        self._config = config

    def plan(
        self, space: PlanningMap, start: SE2, goal: SE2, goes_on: GoesOn = lambda: True
    ) -> Plan | PlanFailure:
        """Return a path that the robot can drive, or why there is none."""
        failure = blocked_ends(space, start, goal)
        if failure is not None:
            return failure
        how = StraightSearch if self._config.steering == "straight" else CurvedSearch
        expanded = 0
        for room in how.rooms(space, self._config):
            search = how(space, room, (start, goal), self._config, priced=self._kind == "rrtstar")
            for _ in range(search.tries if search.may_succeed else 0):
                path = self._grow(search, goes_on)
                if path is None:
                    break
                if (plan := search.plan(path)) is not None:
                    return replace(plan, expanded=expanded + plan.expanded)
            expanded += search.expanded
            if not goes_on():
                return PlanFailure(Reason.OUT_OF_TIME, "the time was over", None, expanded)
        return no_path(space, start, goal, expanded)

    def _grow(self, search: TreeSearch, goes_on: GoesOn) -> PosePath | None:
        """Return a path, or None."""
        if self._kind == "rrtstar":
            return _grow_cheapest(search, goes_on)
        if (path := search.direct()) is not None:
            return path
        return (_grow_single if self._kind == "rrt" else _grow_both)(search, goes_on)


def _grow_single(search: TreeSearch, goes_on: GoesOn) -> PosePath | None:
    """Grow one tree from the start, until a motion from it leads to the goal."""
    tree = search.tree(search.start)
    status, node, left = GOING_ON, -1, search.samples
    while status == GOING_ON and left > 0 and goes_on():
        status, node = grow_to_goal(
            tree, search.course, search.goal, search.rng, _LONGEST, search.rounds
        )
        left -= search.rounds
    search.expanded += int(tree.size[0])
    return search.shortest(search.path(tree, node), tree) if status == FOUND else None


def _grow_both(search: TreeSearch, goes_on: GoesOn) -> PosePath | None:
    """Grow two trees, from start and goal, until they meet."""
    trees = search.tree(search.start), search.tree(search.goal)
    courses = search.course, search.course.backward
    status, one, other, left = GOING_ON, -1, -1, search.samples
    while status == GOING_ON and left > 0 and goes_on():
        status, one, other = grow_both(trees, courses, search.rng, _LONGEST, search.rounds)
        left -= search.rounds
    search.expanded += int(trees[0].size[0] + trees[1].size[0])
    if status != FOUND:
        return None
    path = joined(search.path(trees[0], one), backwards(search.path(trees[1], other)))
    return search.shortest(path, *trees)


def _grow_cheapest(search: TreeSearch, goes_on: GoesOn) -> PosePath | None:
    """Grow one tree whose paths become cheaper as it grows."""
    tree, course = search.tree(search.start), search.course
    straight_on = curve_between(search.start, search.goal, course.radius, course.steering)
    enough = length_of(straight_on, course.radius) + _CHORDS
    at_goal = reach_goal(tree, course, search.goal, 0, -1)
    status, left = GOING_ON, search.samples
    while at_goal < 0 or tree.total[at_goal] > enough:
        if status == FULL or left <= 0 or not goes_on():
            break
        status, at_goal = grow_cheapest(
            tree, course, search.goal, search.rng, _LONGEST, at_goal, search.rounds
        )
        left -= search.rounds
        if at_goal >= 0:
            left = min(left, search.improvements)
    search.expanded += int(tree.size[0])
    return search.path(tree, at_goal) if at_goal >= 0 else None
