"""Correlative scan matching: the best pose of all in a window, by branch and bound.

Score: the mean score of the points, less a penalty for the distance from the prior. Coarse cells
bound it from above, so that most of the window is never looked at and the best is not missed.
Olson, Real-time correlative scan matching, ICRA 2009; Hess, Kohler, Rapp, Andor, Real-time loop
closure in 2D lidar SLAM, ICRA 2016.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.compiled import compiled
from robotctl.estimation.slam.front_end.score_field import LEVELS, RESOLUTION_M, ScoreField
from robotctl.estimation.slam.front_end.surface import Floats
from robotctl.model.geometry.se2 import SE2

POINTS_AS_ONE: Final = 50.0
"""A scan counts as so many independent points beside the prior."""
_TURN_CELLS: Final = 1.0
"""A step of the heading moves the points that are far by so many cells."""


@dataclass(frozen=True, slots=True)
class Window:
    """Where to search: around a pose, so far to each side.

    Parameters
    ----------
    centre
        Of `base` in the frame of the field.
    shift_m, turn_rad
        Half sides, >= 0 [m], [rad].
    sigma_m, sigma_rad
        Standard deviations of the prior, inf: none [m], [rad].
    """

    centre: SE2
    shift_m: float
    turn_rad: float
    sigma_m: float = math.inf
    sigma_rad: float = math.inf


@dataclass(frozen=True, slots=True)
class Found:
    """The best pose of a window, and its mean score 0 to 1 without the penalty."""

    pose: SE2
    score: float


def search(
    field: ScoreField,
    points: Floats,
    window: Window,
    least: float,
    apart: SE2 | None = None,
) -> Found | None:
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
        Poses within 0.5 m and 0.2 rad of this one do not count: is there another as good?
    """
    if len(points) == 0:
        return None
    far_m = max(float(np.percentile(np.hypot(points[:, 0], points[:, 1]), 90.0)), 1.0)
    steps = math.ceil(window.turn_rad / (_TURN_CELLS * RESOLUTION_M / far_m))
    turns = np.linspace(-window.turn_rad, window.turn_rad, 2 * steps + 1)
    half = math.ceil(window.shift_m / RESOLUTION_M)
    centre = window.centre
    excluded = np.full(3, np.inf)
    if apart is not None:
        excluded = np.array(
            [
                (apart.x_m - centre.x_m) / RESOLUTION_M,
                (apart.y_m - centre.y_m) / RESOLUTION_M,
                math.remainder(apart.theta_rad - centre.theta_rad, 2.0 * math.pi),
            ]
        )
    weight = 0.5 / POINTS_AS_ONE
    score, turn, column, row = _branch_and_bound(
        field.cells, field.begins, field.rows, field.columns,
        np.array([centre.x_m - field.x_m, centre.y_m - field.y_m, centre.theta_rad]),
        points, turns, half,
        weight * (RESOLUTION_M / window.sigma_m) ** 2, weight / window.sigma_rad**2,
        least, excluded,
    )  # fmt: skip
    if turn < 0:
        return None
    pose = SE2(
        centre.x_m + column * RESOLUTION_M,
        centre.y_m + row * RESOLUTION_M,
        centre.theta_rad + float(turns[turn]),
    )
    return Found(pose, score)


@compiled
def _score(
    cells: NDArray[np.uint8], begin: int, rows: int, columns: int, level: int,
    own: NDArray[np.int32], column: int, row: int,
) -> float:  # fmt: skip
    """Return the mean score of points in cells, shifted by cells."""
    total = 0
    for k in range(len(own)):
        x = (own[k, 0] + column) >> level
        y = (own[k, 1] + row) >> level
        if 0 <= x < columns and 0 <= y < rows:
            total += cells[begin + y * columns + x]
    return total / (255.0 * len(own))


@compiled
def _penalty(column: int, row: int, side: int, per_cell: float) -> float:
    """Return the least penalty of shifts within a block."""
    x = max(column, 0, -(column + side - 1))
    y = max(row, 0, -(row + side - 1))
    return per_cell * (x * x + y * y)


@compiled
def _branch_and_bound(  # noqa: C901 - one compiled loop
    cells: NDArray[np.uint8], begins: NDArray[np.int64], rows: NDArray[np.int64],
    columns: NDArray[np.int64], centre: Floats, points: Floats, turns: Floats, half: int,
    per_cell: float, per_rad: float, least: float, excluded: Floats,
) -> tuple[float, int, int, int]:  # fmt: skip
    """Return score without penalty, number of the turn (-1: none), column and row of the best."""
    top = LEVELS - 1
    while top > 0 and (1 << top) > half:
        top -= 1
    side = 1 << top
    blocks = (2 * half + side) // side
    count = len(points)
    own = np.empty((len(turns), count, 2), np.int32)
    bounds = np.empty(len(turns) * blocks * blocks)
    for t in range(len(turns)):
        c, s = np.cos(centre[2] + turns[t]), np.sin(centre[2] + turns[t])
        for k in range(count):
            x = centre[0] + c * points[k, 0] - s * points[k, 1]
            y = centre[1] + s * points[k, 0] + c * points[k, 1]
            own[t, k, 0] = int(np.floor(x / RESOLUTION_M))
            own[t, k, 1] = int(np.floor(y / RESOLUTION_M))
        turned = per_rad * turns[t] ** 2
        for i in range(blocks):
            for j in range(blocks):
                row, column = i * side - half, j * side - half
                off = turned + _penalty(column, row, side, per_cell)
                at = (t * blocks + i) * blocks + j
                bounds[at] = -off
                if 1.0 - off > least:
                    bounds[at] += _score(
                        cells, begins[top], rows[top], columns[top], top, own[t], column, row
                    )
    best, best_score, found, found_column, found_row = least, 0.0, -1, 0, 0
    stack = np.empty((4 * LEVELS + 4, 4), np.int64)
    stack_bounds = np.empty(4 * LEVELS + 4)
    for start in np.argsort(-bounds):
        if bounds[start] <= best:
            break
        t = start // (blocks * blocks)
        block = start % (blocks * blocks)
        turned = per_rad * turns[t] ** 2
        stack[0, 0] = top
        stack[0, 1] = block % blocks * side - half
        stack[0, 2] = block // blocks * side - half
        stack_bounds[0] = bounds[start]
        depth = 1
        while depth > 0:
            depth -= 1
            if stack_bounds[depth] <= best:
                continue
            level, column, row = stack[depth, 0], stack[depth, 1], stack[depth, 2]
            if level == 0:
                if abs(column) > half or abs(row) > half:
                    continue
                near = np.hypot(column - excluded[0], row - excluded[1]) * RESOLUTION_M < 0.5
                if near and abs(turns[t] - excluded[2]) < 0.2:
                    continue
                best = stack_bounds[depth]
                best_score = best + turned + _penalty(column, row, 1, per_cell)
                found, found_column, found_row = t, column, row
                continue
            level -= 1
            first = depth
            for child in range(4):
                x = column + ((child & 1) << level)
                y = row + ((child >> 1) << level)
                bound = (
                    _score(cells, begins[level], rows[level], columns[level], level, own[t], x, y)
                    - turned
                    - _penalty(x, y, 1 << level, per_cell)
                )
                if bound <= best:
                    continue
                at = depth
                while at > first and stack_bounds[at - 1] > bound:
                    stack_bounds[at] = stack_bounds[at - 1]
                    stack[at] = stack[at - 1]
                    at -= 1
                stack_bounds[at] = bound
                stack[at, 0], stack[at, 1], stack[at, 2] = level, x, y
                depth += 1
    return best_score, found, found_column, found_row
