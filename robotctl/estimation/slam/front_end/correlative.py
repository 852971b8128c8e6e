"""Correlative scan matching: the best pose of all in a window, by branch and bound.

Score: the mean score of the points, less a penalty for the distance from the prior. It is bounded
from above for blocks of poses: 2^h shifts to each side by 2^h turns, which move a point over so
many cells, too. A block has eight of half the size in it, and most are never looked into.
Olson, Real-time correlative scan matching, ICRA 2009; Hess, Kohler, Rapp, Andor, Real-time loop
closure in 2D lidar SLAM, ICRA 2016, whose blocks are of one turn each.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.estimation.slam.front_end.score_field import LEVELS, RESOLUTION_M, ScoreField
from robotctl.estimation.slam.front_end.surface import Floats
from robotctl.model.geometry.se2 import SE2

POINTS_AS_ONE: Final = 50.0
"""A scan counts as so many independent points beside the prior."""
_TURN_CELLS: Final = 1.0
"""A step of the heading moves the points that are far by so many cells."""
_SAME_M: Final = 0.5
_SAME_RAD: Final = 0.2
"""Poses nearer than this are not another place."""


@dataclass(frozen=True, slots=True)
class Window:
    """Search window around a pose.

    Parameters
    ----------
    centre
        Of `base` in the frame of the field.
    shift_m, turn_rad
        Half sides, >= 0 [m], [rad].
    sigma_m, sigma_rad
        Standard deviations of the prior, inf: none [m], [rad].
    level
        Level of the blocks that are found, for a refinement to begin in; 0: single poses.
    """

    centre: SE2
    shift_m: float
    turn_rad: float
    sigma_m: float = math.inf
    sigma_rad: float = math.inf
    level: int = 0


@dataclass(frozen=True, slots=True)
class Correlation:
    """The best pose of a window, and its mean score 0 to 1 without the penalty.

    Of a block, the pose in its middle and the bound of its scores.
    """

    pose: SE2
    score: float


def search(
    field: ScoreField,
    points: Floats,
    window: Window,
    least: float,
    *apart: SE2,
) -> Correlation | None:
    """Return the best pose for points (n, 2) in `base`, if its score exceeds `least`.

    Parameters
    ----------
    field
        Of the map.
    points
        In `base` [m].
    window
        Where.
    least
        Score that the pose must exceed, penalty included.
    apart
        Poses within 0.5 m and 0.2 rad of one of these do not count: is there another as good?
    """
    if len(points) == 0:
        return None
    far_m = max(_most_within_m(points), 1.0)
    steps = math.ceil(window.turn_rad / (_TURN_CELLS * RESOLUTION_M / far_m))
    turns = np.linspace(-window.turn_rad, window.turn_rad, 2 * steps + 1)
    half = math.ceil(window.shift_m / RESOLUTION_M)
    centre = window.centre
    excluded = np.array(
        [
            (
                (each.x_m - centre.x_m) / RESOLUTION_M,
                (each.y_m - centre.y_m) / RESOLUTION_M,
                math.remainder(each.theta_rad - centre.theta_rad, 2.0 * math.pi),
            )
            for each in apart
        ]
    ).reshape(-1, 3)
    weight = 0.5 / POINTS_AS_ONE
    poses = _Poses(
        np.array([centre.x_m - field.x_m, centre.y_m - field.y_m, centre.theta_rad]),
        turns, half, weight * (RESOLUTION_M / window.sigma_m) ** 2, weight / window.sigma_rad**2,
    )  # fmt: skip
    score, turn, column, row = _best(field.cells, points, poses, least, excluded, window.level)
    if turn < 0:
        return None
    more = (1 << window.level) - 1  # cells and turns of a block beyond its first
    last = min(turn + more, len(turns) - 1)
    pose = SE2(
        centre.x_m + (column + 0.5 * more) * RESOLUTION_M,
        centre.y_m + (row + 0.5 * more) * RESOLUTION_M,
        centre.theta_rad + 0.5 * float(turns[turn] + turns[last]),
    )
    return Correlation(pose, score)


def _most_within_m(points: Floats) -> float:
    """Return the distance from the origin within which nine of ten points (n, 2) are; n > 0.

    For a few hundred points `np.percentile` takes ten times as long.
    """
    away_m = np.sort(np.hypot(points[:, 0], points[:, 1]))
    at = 0.9 * (len(away_m) - 1)
    low_m, high_m = away_m[int(at)], away_m[math.ceil(at)]
    return float(low_m + (high_m - low_m) * (at - int(at)))


class _Poses(NamedTuple):
    """The poses of a window.

    Parameters
    ----------
    centre
        x, y [m], heading [rad] in the field.
    turns
        From the centre's heading, an odd number, ascending, 0 in the middle [rad].
    half
        Greatest shift to each side [cells].
    per_cell, per_rad
        Penalties of a shift and a turn, by their squares.
    """

    centre: Floats
    turns: Floats
    half: int
    per_cell: float
    per_rad: float


@compiled
def _penalty(poses: _Poses, column: int, row: int, side: int, first: int, last: int) -> float:
    """Return the least penalty of the shifts of a block and of some turns."""
    x = max(column, 0, -(column + side - 1))
    y = max(row, 0, -(row + side - 1))
    turn: float = poses.turns[min(max(first, len(poses.turns) // 2), last)]
    return poses.per_cell * (x * x + y * y) + poses.per_rad * turn * turn


@compiled
def _enter(
    points: Floats, poses: _Poses, first: int, last: int, side: int, corners: NDArray[np.int32]
) -> None:
    """Enter the corner of the cells where each point is over some turns, unshifted, (n, 3).

    And the level with which a block from there holds them after the shifts of a block, too;
    LEVELS: none does.
    """
    middle = 0.5 * (poses.turns[first] + poses.turns[last])
    half = 0.5 * (poses.turns[last] - poses.turns[first])
    c, s = np.cos(poses.centre[2] + middle), np.sin(poses.centre[2] + middle)
    along, across = np.sin(half), 1.0 - np.cos(half)
    spare = 1e-9 if half > 0.0 else 0.0
    for k in range(len(points)):
        x = c * points[k, 0] - s * points[k, 1]
        y = s * points[k, 0] + c * points[k, 1]
        dx = abs(y) * along + abs(x) * across + spare
        dy = abs(x) * along + abs(y) * across + spare
        x, y = x + poses.centre[0], y + poses.centre[1]
        column = int(np.floor((x - dx) / RESOLUTION_M))
        row = int(np.floor((y - dy) / RESOLUTION_M))
        spread = max(
            int(np.floor((x + dx) / RESOLUTION_M)) - column,
            int(np.floor((y + dy) / RESOLUTION_M)) - row,
        )
        level = 0
        while level < LEVELS and 1 << level < side + spread:
            level += 1
        corners[k, 0], corners[k, 1], corners[k, 2] = column, row, level


@compiled
def _score_row(
    cells: NDArray[np.uint8], corners: NDArray[np.int32], column: int, row: int, side: int,
    sums: NDArray[np.int64],
) -> None:  # fmt: skip
    """Fill in the scores of the blocks of a row, that begins at a shift."""
    _, rows, columns = cells.shape
    sums[:] = 0
    for k in range(len(corners)):
        x, y, level = corners[k, 0] + column, corners[k, 1] + row, corners[k, 2]
        if level == LEVELS:
            sums += 255
        elif 0 <= y < rows:
            for block in range(len(sums)):
                if 0 <= x < columns:
                    sums[block] += cells[level, y, x]
                x += side


@compiled
def _score_four(
    cells: NDArray[np.uint8], corners: NDArray[np.int32], column: int, row: int, side: int,
    sums: NDArray[np.int64],
) -> None:  # fmt: skip
    """Fill in the scores of the four blocks in one of twice the size, by rows."""
    _, rows, columns = cells.shape
    a = b = c = d = 0
    for k in range(len(corners)):
        x, y, level = corners[k, 0] + column, corners[k, 1] + row, corners[k, 2]
        if level == LEVELS:
            a, b, c, d = a + 255, b + 255, c + 255, d + 255
        elif 0 <= x < columns - side and 0 <= y < rows - side:
            a += cells[level, y, x]
            b += cells[level, y, x + side]
            c += cells[level, y + side, x]
            d += cells[level, y + side, x + side]
        else:
            is_left, is_right = 0 <= x < columns, 0 <= x + side < columns
            if 0 <= y < rows:
                a += cells[level, y, x] if is_left else 0
                b += cells[level, y, x + side] if is_right else 0
            if 0 <= y + side < rows:
                c += cells[level, y + side, x] if is_left else 0
                d += cells[level, y + side, x + side] if is_right else 0
    sums[0], sums[1], sums[2], sums[3] = a, b, c, d


@compiled
def _is_excluded(
    poses: _Poses, excluded: Floats, column: int, row: int, side: int, first: int, last: int
) -> bool:
    """Return whether a block is near a pose that does not count, all of it."""
    for k in range(len(excluded)):
        x = max(abs(column - excluded[k, 0]), abs(column + side - 1 - excluded[k, 0]))
        y = max(abs(row - excluded[k, 1]), abs(row + side - 1 - excluded[k, 1]))
        middle = 0.5 * (poses.turns[first] + poses.turns[last]) - excluded[k, 2]
        middle -= 2.0 * np.pi * np.floor((middle + np.pi) / (2.0 * np.pi))
        turn = abs(middle) + 0.5 * (poses.turns[last] - poses.turns[first])
        if turn < _SAME_RAD and np.hypot(x, y) * RESOLUTION_M < _SAME_M:
            return True
    return False


class _Kept(NamedTuple):
    """Places of the points over turns: of 2^h turns at level h, group by group, level by level.

    Parameters
    ----------
    starts
        First group of each level, (levels + 1,).
    corners
        As `_enter` has them, (groups, n, 3); entered when they are needed.
    is_entered
        Which are, (groups,).
    """

    starts: NDArray[np.int64]
    corners: NDArray[np.int32]
    is_entered: NDArray[np.bool_]


@compiled
def _turns_of(poses: _Poses, level: int, group: int) -> tuple[int, int]:
    """Return the first and the last turn of a group."""
    return group << level, min((group + 1) << level, len(poses.turns)) - 1


@compiled
def _corners(
    points: Floats, poses: _Poses, level: int, group: int, kept: _Kept
) -> NDArray[np.int32]:
    """Return where the points are over the turns of a group, (n, 3)."""
    at = kept.starts[level] + group
    own: NDArray[np.int32] = kept.corners[at]
    if not kept.is_entered[at]:
        first, last = _turns_of(poses, level, group)
        _enter(points, poses, first, last, 1 << level, own)
        kept.is_entered[at] = True
    return own


@compiled
def _bounds(
    cells: NDArray[np.uint8], points: Floats, poses: _Poses, top: int, blocks: int, kept: _Kept
) -> Floats:
    """Return the bounds of all blocks of a level, (groups * blocks * blocks,)."""
    side, half = 1 << top, poses.half
    groups = kept.starts[top + 1] - kept.starts[top]
    result, sums = np.empty(groups * blocks * blocks), np.empty(blocks, np.int64)
    for group in range(groups):
        first, last = _turns_of(poses, top, group)
        own = _corners(points, poses, top, group, kept)
        for i in range(blocks):
            row = i * side - half
            _score_row(cells, own, -half, row, side, sums)
            for j in range(blocks):
                score = sums[j] / (255.0 * len(points))
                off = _penalty(poses, j * side - half, row, side, first, last)
                result[(group * blocks + i) * blocks + j] = score - off
    return result


@compiled
def _insert(
    stack: NDArray[np.int64], bounds: Floats, begin: int, depth: int, bound: float,
    level: int, group: int, column: int, row: int,
) -> None:  # fmt: skip
    """Insert a block among those from `begin` to `depth`, the best at the end."""
    at = depth
    while at > begin and bounds[at - 1] > bound:
        bounds[at] = bounds[at - 1]
        stack[at] = stack[at - 1]
        at -= 1
    bounds[at] = bound
    stack[at, 0], stack[at, 1], stack[at, 2], stack[at, 3] = level, group, column, row


@compiled
def _best(  # noqa: C901 - one compiled loop
    cells: NDArray[np.uint8], points: Floats, poses: _Poses, least: float, excluded: Floats,
    leaf: int,
) -> tuple[float, int, int, int]:  # fmt: skip
    """Return the best block of a level: its score without penalty, first turn, column and row.

    The turn is -1 where there is none.
    """
    half, top = poses.half, LEVELS - 2
    while top > 0 and 1 << top > half:
        top -= 1
    starts = np.zeros(top + 2, np.int64)
    for level in range(top + 1):
        starts[level + 1] = starts[level] + ((len(poses.turns) - 1) >> level) + 1
    corners = np.empty((starts[top + 1], len(points), 3), np.int32)
    kept = _Kept(starts, corners, np.zeros(starts[top + 1], np.bool_))
    blocks = (2 * half >> top) + 1
    bounds = _bounds(cells, points, poses, top, blocks, kept)
    best, best_score, found, found_column, found_row = least, 0.0, -1, 0, 0
    stack, stack_bounds = np.empty((8 * LEVELS, 4), np.int64), np.empty(8 * LEVELS)
    sums = np.empty(4, np.int64)
    for start in np.argsort(-bounds):
        if bounds[start] <= best:
            break
        stack[0, 0], stack[0, 1] = top, start // (blocks * blocks)
        stack[0, 2] = (start % blocks << top) - half
        stack[0, 3] = (start // blocks % blocks << top) - half
        stack_bounds[0] = bounds[start]
        depth = 1
        while depth > 0:
            depth -= 1
            if stack_bounds[depth] <= best:
                continue
            level, group, column, row = stack[depth]
            first, last = _turns_of(poses, level, group)
            if _is_excluded(poses, excluded, column, row, 1 << level, first, last):
                continue
            if level <= leaf:
                best = stack_bounds[depth]
                best_score = best + _penalty(poses, column, row, 1 << level, first, last)
                found, found_column, found_row = first, column, row
                continue
            level -= 1
            side, begin = 1 << level, depth
            for part in range(2 * group, min(2 * group + 2, starts[level + 1] - starts[level])):
                first, last = _turns_of(poses, level, part)
                own = _corners(points, poses, level, part, kept)
                _score_four(cells, own, column, row, side, sums)
                for child in range(4):
                    x, y = column + (child & 1) * side, row + (child >> 1) * side
                    off = _penalty(poses, x, y, side, first, last)
                    bound = sums[child] / (255.0 * len(points)) - off
                    if bound <= best or x > half or y > half:
                        continue
                    _insert(stack, stack_bounds, begin, depth, bound, level, part, x, y)
                    depth += 1
    return best_score, found, found_column, found_row
