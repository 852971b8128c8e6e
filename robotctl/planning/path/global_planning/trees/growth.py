"""Growth of random trees: RRT, RRT-Connect and informed RRT*, each over straight pieces or curves.

RRT: LaValle, "Rapidly-exploring random trees", 1998. RRT-Connect: Kuffner and LaValle 2000. RRT*:
Karaman and Frazzoli, "Sampling-based algorithms for optimal motion planning", 2011; informed
samples: Gammell, Srinivasa, Barfoot 2014. Over curves: LaValle and Kuffner, "Randomized
kinodynamic planning", 2001; Karaman and Frazzoli, "Sampling-based optimal motion planning for
non-holonomic dynamical systems", 2013.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.planning.map.planning_map import body_hits
from robotctl.planning.path.global_planning.trees.motions import (
    STRAIGHT,
    Course,
    advance,
    curve_between,
    drive,
    least_cost,
    length_of,
)
from robotctl.planning.path.global_planning.trees.tree import (
    Tree,
    add_pose,
    joint,
    nearest_pose,
    poses_near,
    set_parent,
)

FOUND, GOING_ON, FULL = 2, 1, 0
_NARROW_SHARE: Final = 0.3
_GOAL_SHARE: Final = 0.05
_TRIES: Final = 100
"""At a pose at which the body is free."""
_NEIGHBOURS: Final = 24
"""Neighbours that RRT* asks over curves, which cost more to try than straight pieces."""
_MOST_NEIGHBOURS: Final = 256
"""The same over straight pieces."""


@compiled
def _sample(course: Course, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return a random pose: a free point, or one at which the body is free if some tries find it.

    A share of them lies in narrow passages.
    """
    pose = np.zeros(3)
    for _ in range(_TRIES):
        if len(course.narrow) > 0 and rng.random() < _NARROW_SHARE:
            cell = course.narrow[int(rng.random() * len(course.narrow))]
        else:
            cell = course.free[int(rng.random() * len(course.free))]
        pose[0] = cell[1] + rng.random()
        pose[1] = cell[0] + rng.random()
        if course.steering == STRAIGHT:
            break
        pose[2] = 2.0 * math.pi * rng.random()
        if not body_hits(
            course.blocked, course.clearance, course.samples, course.discs,
            pose[0], pose[1], pose[2],
        ):  # fmt: skip
            break
    return pose


@compiled
def _grow(
    tree: Tree, course: Course, pose: NDArray[np.float64], longest: float
) -> tuple[int, bool]:
    """Grow from the nearest pose towards another; return the new pose, and whether it is there.

    -1 where nothing could grow.
    """
    near, curve = nearest_pose(tree, pose, course.radius, course.steering)
    may, end, part, cost, is_there = advance(course, tree.pose[near], curve, pose, longest)
    return (add_pose(tree, end, near, part, cost), is_there) if may else (-1, False)


@compiled
def grow_to_goal(
    tree: Tree,
    course: Course,
    goal: NDArray[np.float64],
    rng: np.random.Generator,
    longest: float,
    rounds: int,
) -> tuple[int, int]:
    """RRT: grow for some rounds; return the state, and the pose that is the goal."""
    for _ in range(rounds):
        if tree.size[0] + 2 > len(tree.parent):
            return FULL, -1
        is_goal = rng.random() < _GOAL_SHARE
        pose = goal if is_goal else _sample(course, rng)
        node, is_there = _grow(tree, course, pose, longest)
        if node < 0:
            continue
        if is_there and is_goal:
            return FOUND, node
        end = tree.pose[node]
        if math.hypot(goal[0] - end[0], goal[1] - end[1]) > longest:
            continue
        curve = curve_between(end, goal, course.radius, course.steering)
        is_free, cost = drive(course, end, curve, goal)
        if is_free:
            return FOUND, add_pose(tree, goal, node, curve, cost)
    return GOING_ON, -1


@compiled
def grow_both(
    trees: tuple[Tree, Tree],
    courses: tuple[Course, Course],
    rng: np.random.Generator,
    longest: float,
    rounds: int,
) -> tuple[int, int, int]:
    """RRT-Connect: grow one tree, let the other grow to the new pose, take turns.

    Return the state, and the poses of both trees that met. The second tree grows from the goal.
    """
    for turn in range(rounds):
        first = turn % 2
        one, other = (trees[0], trees[1]) if first == 0 else (trees[1], trees[0])
        ahead, back = (courses[0], courses[1]) if first == 0 else (courses[1], courses[0])
        if one.size[0] + 2 > len(one.parent) or other.size[0] + 2 > len(other.parent):
            return FULL, -1, -1
        node, _ = _grow(one, ahead, _sample(ahead, rng), longest)
        if node < 0:
            continue
        met, is_there = _grow(other, back, one.pose[node], np.inf)
        if is_there:
            return (FOUND, node, met) if first == 0 else (FOUND, met, node)
    return GOING_ON, -1, -1


@compiled
def grow_cheapest(
    tree: Tree,
    course: Course,
    goal: NDArray[np.float64],
    rng: np.random.Generator,
    longest: float,
    at_goal: int,
    rounds: int,
) -> tuple[int, int]:
    """RRT*: grow for some rounds, by the cheapest parent near by, and let neighbours change theirs.

    `at_goal` is the pose that is the goal, -1: none yet. Once there is one, samples that cannot lie
    on a cheaper path are left out. Return the state, and the pose that is the goal.
    """
    is_straight = course.steering == STRAIGHT
    near = np.empty(_MOST_NEIGHBOURS if is_straight else _NEIGHBOURS, np.int64)
    root = tree.pose[0].copy()
    for _ in range(rounds):
        best = tree.total[at_goal] if at_goal >= 0 else np.inf
        if tree.size[0] + 2 > len(tree.parent):
            return FULL, at_goal
        pose = _sample(course, rng)
        if not _may_help(course, root, pose, goal, best):
            continue
        node, _ = _grow(tree, course, pose, longest)
        if node < 0:
            continue
        # So many lie within this distance, if they lie evenly. Straight pieces: Karaman and
        # Frazzoli 2011, theorem 38, in the plane: 2 (1 + 1/2)^(1/2) (area / pi)^(1/2).
        count = tree.size[0]
        some = 6.0 * math.log(count + 1.0) if is_straight else 1.0 * _NEIGHBOURS
        reach = min(math.sqrt(some * len(course.free) / (math.pi * count)), longest)
        found = poses_near(tree, tree.pose[node], reach, near)
        _take_cheapest_parent(tree, course, node, near[:found])
        _rewire(tree, course, node, near[:found])
        at_goal = reach_goal(tree, course, goal, node, at_goal)
    return GOING_ON, at_goal


@compiled
def _may_help(
    course: Course,
    root: NDArray[np.float64],
    pose: NDArray[np.float64],
    goal: NDArray[np.float64],
    best: float,
) -> bool:
    """Return whether a path over a pose can be cheaper than the best."""
    if best == np.inf:
        return True
    straight = math.hypot(pose[0] - root[0], pose[1] - root[1])
    straight += math.hypot(goal[0] - pose[0], goal[1] - pose[1])
    if straight >= best or course.steering == STRAIGHT:
        return straight < best
    before = curve_between(root, pose, course.radius, course.steering)
    after = curve_between(pose, goal, course.radius, course.steering)
    return length_of(before, course.radius) + length_of(after, course.radius) < best


@compiled
def _take_cheapest_parent(tree: Tree, course: Course, node: int, near: NDArray[np.int64]) -> None:
    """Give a new pose the parent with the cheapest path from the root."""
    pose, least = tree.pose[node], tree.total[node]
    for other in near:
        if other == node:
            continue
        before = tree.total[other]
        away = math.hypot(pose[0] - tree.pose[other, 0], pose[1] - tree.pose[other, 1])
        if before + away >= least:
            continue
        curve = curve_between(tree.pose[other], pose, course.radius, course.steering)
        before += joint(tree, other, curve)
        if before + least_cost(curve, course.radius) >= least - 1e-9:
            continue
        is_free, cost = drive(course, tree.pose[other], curve, pose)
        if is_free and before + cost < least - 1e-9:
            least = before + cost
            set_parent(tree, node, other, curve, cost)


@compiled
def _rewire(tree: Tree, course: Course, node: int, near: NDArray[np.int64]) -> None:
    """Make a new pose the parent of neighbours that it brings closer to the root."""
    pose, before = tree.pose[node], tree.total[node]
    for other in near:
        if other == node:
            continue
        least = tree.total[other]
        away = math.hypot(pose[0] - tree.pose[other, 0], pose[1] - tree.pose[other, 1])
        if before + away >= least:
            continue
        curve = curve_between(pose, tree.pose[other], course.radius, course.steering)
        turn = joint(tree, node, curve)
        if before + turn + least_cost(curve, course.radius) >= least - 1e-9:
            continue
        is_free, cost = drive(course, pose, curve, tree.pose[other])
        if is_free and before + turn + cost < least - 1e-9:
            set_parent(tree, other, node, curve, cost)


@compiled
def reach_goal(
    tree: Tree, course: Course, goal: NDArray[np.float64], node: int, at_goal: int
) -> int:
    """Go to the goal from a new pose, if that is cheaper; return the pose that is the goal."""
    pose, before = tree.pose[node], tree.total[node]
    best = tree.total[at_goal] if at_goal >= 0 else np.inf
    if before + math.hypot(goal[0] - pose[0], goal[1] - pose[1]) >= best:
        return at_goal
    curve = curve_between(pose, goal, course.radius, course.steering)
    before += joint(tree, node, curve)
    if before + least_cost(curve, course.radius) >= best - 1e-9:
        return at_goal
    is_free, cost = drive(course, pose, curve, goal)
    if not is_free or before + cost >= best - 1e-9:
        return at_goal
    if at_goal < 0:
        return add_pose(tree, goal, node, curve, cost)
    set_parent(tree, at_goal, node, curve, cost)
    return at_goal
