"""Growth of trees of poses: RRT, RRT-Connect and informed RRT* over curves.

Sources as in `point_tree`; with curves in place of straight pieces: LaValle and Kuffner,
"Randomized kinodynamic planning", 2001; Karaman and Frazzoli, "Sampling-based optimal motion
planning for non-holonomic dynamical systems", 2013.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.compiled import compiled
from robotctl.planning.map.planning_map import body_hits
from robotctl.planning.path.global_planning.trees.motions import (
    Course,
    beginning,
    curve_between,
    drive_along,
    end_of,
    least_cost,
    length_of,
)
from robotctl.planning.path.global_planning.trees.point_tree import FOUND, FULL, GOING_ON, sample
from robotctl.planning.path.global_planning.trees.pose_tree import (
    PoseTree,
    add_pose,
    cost_of,
    joint,
    nearest_pose,
    poses_near,
)

_LEAST_STEP: Final = 1.0
"""A shorter motion brings nothing [cells]."""
_BACK_OFF: Final = 0.8
"""Share of the free part of a motion that is driven: no curve leads on from an obstacle."""
_NARROW_SHARE: Final = 0.3
_GOAL_SHARE: Final = 0.05
_TRIES: Final = 100
"""At a pose at which the body is free."""
_NEIGHBOURS: Final = 24


@compiled
def sample_pose(
    course: Course,
    free: NDArray[np.int32],
    narrow: NDArray[np.int32],
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Return a random pose at which the body is free, if some tries find one."""
    pose = np.empty(3)
    for _ in range(_TRIES):
        pose[0], pose[1] = sample(rng, free, narrow, _NARROW_SHARE)
        pose[2] = 2.0 * math.pi * rng.random()
        if not body_hits(
            course.blocked, course.clearance, course.samples, course.discs,
            pose[0], pose[1], pose[2],
        ):  # fmt: skip
            break
    return pose


@compiled
def grow_pose(
    tree: PoseTree, course: Course, pose: NDArray[np.float64], gears: int, longest: float
) -> tuple[int, bool]:
    """Grow from the nearest pose towards another; return the new pose, and whether it is there.

    -1 where nothing could grow.
    """
    near, curve = nearest_pose(tree, pose, course.radius, gears)
    way, cost = drive_along(course, tree.pose[near], curve, longest)
    if way == math.inf:
        return add_pose(tree, pose, near, curve, cost), True
    length = way if length_of(curve, course.radius) > longest <= way + 1.0 else _BACK_OFF * way
    if length < _LEAST_STEP:
        return -1, False
    part = beginning(curve, length / course.radius)
    way, cost = drive_along(course, tree.pose[near], part, np.inf)
    if way < np.inf:  # the body is checked at other poses than before
        return -1, False
    end = end_of(tree.pose[near], part, course.radius)
    return add_pose(tree, end, near, part, cost), False


@compiled
def grow_to_goal(
    tree: PoseTree,
    course: Course,
    goal: NDArray[np.float64],
    gears: int,
    free: NDArray[np.int32],
    narrow: NDArray[np.int32],
    rng: np.random.Generator,
    longest: float,
    rounds: int,
) -> tuple[int, int]:
    """RRT: grow for some rounds; return the state, and the pose that is the goal."""
    for _ in range(rounds):
        if tree.size[0] + 2 > len(tree.parent):
            return FULL, -1
        is_goal = rng.random() < _GOAL_SHARE
        pose = goal if is_goal else sample_pose(course, free, narrow, rng)
        node, is_there = grow_pose(tree, course, pose, gears, longest)
        if node < 0:
            continue
        if is_there and is_goal:
            return FOUND, node
        end = tree.pose[node]
        if math.hypot(goal[0] - end[0], goal[1] - end[1]) > longest:
            continue
        curve = curve_between(end, goal, course.radius, gears)
        way, cost = drive_along(course, end, curve, np.inf)
        if way == np.inf:
            return FOUND, add_pose(tree, goal, node, curve, cost)
    return GOING_ON, -1


@compiled
def grow_pose_trees(
    trees: tuple[PoseTree, PoseTree],
    course: Course,
    gears: int,
    free: NDArray[np.int32],
    narrow: NDArray[np.int32],
    rng: np.random.Generator,
    longest: float,
    rounds: int,
) -> tuple[int, int, int]:
    """RRT-Connect: grow one tree, let the other grow to the new pose, take turns.

    Return the state, and the poses of both trees that met. The second tree grows from the goal.
    """
    for turn in range(rounds):
        is_first = turn % 2 == 0
        one, other = (trees[0], trees[1]) if is_first else (trees[1], trees[0])
        if one.size[0] + 2 > len(one.parent) or other.size[0] + 2 > len(other.parent):
            return FULL, -1, -1
        ahead = gears if is_first else -gears
        pose = sample_pose(course, free, narrow, rng)
        node, _ = grow_pose(one, course, pose, ahead, longest)
        if node < 0:
            continue
        met, is_there = grow_pose(other, course, one.pose[node], -ahead, np.inf)
        if is_there:
            return (FOUND, node, met) if is_first else (FOUND, met, node)
    return GOING_ON, -1, -1


@compiled
def grow_cheapest(
    tree: PoseTree,
    course: Course,
    goal: NDArray[np.float64],
    gears: int,
    free: NDArray[np.int32],
    narrow: NDArray[np.int32],
    rng: np.random.Generator,
    longest: float,
    at_goal: int,
    rounds: int,
) -> tuple[int, int]:
    """RRT*: grow for some rounds, by the cheapest parent near by, and let neighbours change theirs.

    `at_goal` is the pose that is the goal, -1: none yet. Once there is one, samples that cannot lie
    on a cheaper path are left out. Return the state, and the pose that is the goal.
    """
    near = np.empty(_NEIGHBOURS, np.int64)
    root = tree.pose[0].copy()
    if tree.size[0] == 1:
        at_goal = _reach_goal(tree, course, goal, gears, tree.size[0] - 1, at_goal)
    for _ in range(rounds):
        best = cost_of(tree, at_goal) if at_goal >= 0 else np.inf
        if tree.size[0] + 2 > len(tree.parent):
            return FULL, at_goal
        pose = sample_pose(course, free, narrow, rng)
        if not _may_help(course, root, pose, goal, gears, best):
            continue
        node, _ = grow_pose(tree, course, pose, gears, longest)
        if node < 0:
            continue
        # So many of the poses that there are lie within this distance, if they lie evenly.
        reach = min(math.sqrt(_NEIGHBOURS * len(free) / (math.pi * tree.size[0])), longest)
        found = poses_near(tree, tree.pose[node], reach, near)
        _take_cheapest_parent(tree, course, gears, node, near[:found])
        _rewire_poses(tree, course, gears, node, near[:found])
        at_goal = _reach_goal(tree, course, goal, gears, node, at_goal)
    return GOING_ON, at_goal


@compiled
def _may_help(
    course: Course,
    root: NDArray[np.float64],
    pose: NDArray[np.float64],
    goal: NDArray[np.float64],
    gears: int,
    best: float,
) -> bool:
    """Return whether a path over a pose can be cheaper than the best."""
    if best == np.inf:
        return True
    straight = math.hypot(pose[0] - root[0], pose[1] - root[1])
    straight += math.hypot(goal[0] - pose[0], goal[1] - pose[1])
    if straight >= best:
        return False
    way = length_of(curve_between(root, pose, course.radius, gears), course.radius)
    way += length_of(curve_between(pose, goal, course.radius, gears), course.radius)
    return way < best


@compiled
def _take_cheapest_parent(
    tree: PoseTree, course: Course, gears: int, node: int, near: NDArray[np.int64]
) -> None:
    """Give a new pose the parent with the cheapest path from the root."""
    pose, least = tree.pose[node], cost_of(tree, node)
    for other in near:
        if other == node:
            continue
        before = cost_of(tree, other)
        away = math.hypot(pose[0] - tree.pose[other, 0], pose[1] - tree.pose[other, 1])
        if before + away >= least:
            continue
        curve = curve_between(tree.pose[other], pose, course.radius, gears)
        before += joint(tree, other, curve)
        if before + least_cost(curve, course.radius) >= least - 1e-9:
            continue
        way, cost = drive_along(course, tree.pose[other], curve, np.inf)
        if way == np.inf and before + cost < least - 1e-9:
            least = before + cost
            tree.parent[node], tree.cost[node] = other, cost
            tree.curve[node] = curve


@compiled
def _rewire_poses(
    tree: PoseTree, course: Course, gears: int, node: int, near: NDArray[np.int64]
) -> None:
    """Make a new pose the parent of neighbours that it brings closer to the root."""
    pose, before = tree.pose[node], cost_of(tree, node)
    for other in near:
        if other == node:
            continue
        least = cost_of(tree, other)
        away = math.hypot(pose[0] - tree.pose[other, 0], pose[1] - tree.pose[other, 1])
        if before + away >= least:
            continue
        curve = curve_between(pose, tree.pose[other], course.radius, gears)
        turn = joint(tree, node, curve)
        if before + turn + least_cost(curve, course.radius) >= least - 1e-9:
            continue
        way, cost = drive_along(course, pose, curve, np.inf)
        if way == np.inf and before + turn + cost < least - 1e-9:
            tree.parent[other], tree.cost[other] = node, cost
            tree.curve[other] = curve


@compiled
def _reach_goal(
    tree: PoseTree,
    course: Course,
    goal: NDArray[np.float64],
    gears: int,
    node: int,
    at_goal: int,
) -> int:
    """Go to the goal from a new pose, if that is cheaper; return the pose that is the goal."""
    pose, before = tree.pose[node], cost_of(tree, node)
    best = cost_of(tree, at_goal) if at_goal >= 0 else np.inf
    if before + math.hypot(goal[0] - pose[0], goal[1] - pose[1]) >= best:
        return at_goal
    curve = curve_between(pose, goal, course.radius, gears)
    before += joint(tree, node, curve)
    if before + least_cost(curve, course.radius) >= best - 1e-9:
        return at_goal
    way, cost = drive_along(course, pose, curve, np.inf)
    if way < np.inf or before + cost >= best - 1e-9:
        return at_goal
    if at_goal < 0:
        return add_pose(tree, goal, node, curve, cost)
    tree.parent[at_goal], tree.cost[at_goal] = node, cost
    tree.curve[at_goal] = curve
    return at_goal
