"""Shortest paths over cells that have costs: Dijkstra's algorithm and A*.

Each step goes to one of eight neighbours and costs its length, 1 or sqrt(2) cells, times the
factor of the cell it leads to. A* (Hart, Nilsson, Raphael 1968) is led by the octile distance, the
length of the shortest path without obstacles, which never overestimates since no factor is below 1.

The open list is of buckets (Dial 1969): entries whose estimates differ by less than a bucket's
width come in no order, so a cell may be expanded again by a shorter path; the search ends when no
bucket can hold a shorter one to the goal, and is exact. It works in pieces, so that its caller can
watch the time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import borrows, compiled

Corners: TypeAlias = Literal["both", "one", "none"]
"""How many of the two cells beside a diagonal step must be free."""

LETHAL: Final = 254
"""Cost of an obstacle."""

_RULES: Final[dict[Corners, int]] = {"both": 2, "one": 1, "none": 0}

SQRT2: Final = math.sqrt(2.0)
_BUCKET: Final = 0.5
"""Width of a bucket [cells]: half of the shortest step was the fastest of 0.1 to 1."""
_PIECE: Final = 100_000
"""Cells expanded between two looks at the time: some 10 ms."""
_GOING_ON, _POOL_FULL, _ENDED = 0, 1, 2
_BUCKET_NOW, _LIVE, _USED, _SPARE, _EXPANDED = range(5)
"""Places in the state of a search."""

_ROW_STEPS: Final = np.array([0, 0, 1, -1, 1, 1, -1, -1])
_COLUMN_STEPS: Final = np.array([1, -1, 0, 0, 1, -1, 1, -1])
_LENGTHS: Final = np.sqrt(np.abs(_ROW_STEPS) + np.abs(_COLUMN_STEPS))


@dataclass(frozen=True, slots=True, eq=False)
class CellPath:
    """Result of a search.

    Parameters
    ----------
    cells
        (n, 2) rows and columns from start to goal; (0, 2) if there is no path.
    cost
        Of the path [cells]; inf if there is none.
    expanded
        How many cells were expanded.
    in_time
        Whether the search came to its end.
    """

    cells: NDArray[np.int64]
    cost: float
    expanded: int
    in_time: bool = True


def search_cells(
    costs: NDArray[np.uint8],
    factors: NDArray[np.float64],
    start: tuple[int, int],
    goal: tuple[int, int],
    *,
    corners: Corners = "both",
    guided: bool = True,
    goes_on: Callable[[], bool] = lambda: True,
) -> CellPath:
    """Return the cheapest path between two cells.

    Parameters
    ----------
    costs
        (rows, columns) uint8.
    factors
        (256,): what a step into a cell of each cost takes, as a multiple of its length, >= 1; inf
        where the robot cannot be, `LETHAL` among them.
    start, goal
        Row and column.
    corners
        How many of the two cells beside a diagonal step must be free.
    guided
        A*; otherwise Dijkstra's algorithm, which searches equally in all directions.
    goes_on
        Asked now and then whether there is time left.

    Raises
    ------
    ValueError
        If a cell lies outside the map, or the factors are invalid.
    """
    _check(costs, factors, start, goal)
    if math.inf in (factors[costs[start]], factors[costs[goal]]):
        return CellPath(np.empty((0, 2), np.int64), math.inf, 0)
    rows, columns = costs.shape
    width = columns + 2
    padded = np.full((rows + 2, width), LETHAL, np.uint8)
    padded[1:-1, 1:-1] = costs
    begin, end = ((row + 1) * width + column + 1 for row, column in (start, goal))
    reached = np.zeros(padded.size)  # cost + 1: a page of zeros costs nothing until it is touched
    came = np.zeros(padded.size, np.int8)
    buckets = np.full(
        int(2.0 * SQRT2 * factors[factors < math.inf].max() / _BUCKET) + 3, -1, np.int32
    )
    links, paid = np.empty((2, 1024), np.int32), np.empty(1024)
    state = np.zeros(5, np.int64)
    _begin(reached, buckets, links, paid, state, begin)
    status, in_time = _GOING_ON, True
    while status != _ENDED:
        status = _expand(
            padded.ravel(), factors, reached, came, buckets, links, paid, state,
            width, begin, end, _RULES[corners], guided, _PIECE,
        )  # fmt: skip
        if status == _POOL_FULL:
            links = np.concatenate([links, np.empty_like(links)], axis=1)
            paid = np.concatenate([paid, np.empty_like(paid)])
        elif status == _GOING_ON and not goes_on():
            in_time = False
            break
    expanded = int(state[_EXPANDED])
    if reached[end] == 0.0 or not in_time:
        return CellPath(np.empty((0, 2), np.int64), math.inf, expanded, in_time)
    return CellPath(_path(came, width, begin, end), reached[end] - 1.0, expanded)


def _check(
    costs: NDArray[np.uint8],
    factors: NDArray[np.float64],
    start: tuple[int, int],
    goal: tuple[int, int],
) -> None:
    """Raise ValueError if an end lies outside the map, or the factors are invalid."""
    rows, columns = costs.shape
    for name, (row, column) in (("start", start), ("goal", goal)):
        if not (0 <= row < rows and 0 <= column < columns):
            raise ValueError(f"{name} {row}, {column} lies outside of {rows} rows x {columns}")
    if factors.shape != (256,) or not factors.min() >= 1.0 or factors[LETHAL] != math.inf:
        raise ValueError(f"factors must be (256,), at least 1, and inf for {LETHAL}")


def octile_length(cells: NDArray[np.int64]) -> float:
    """Return the length of a path of neighbouring cells (n, 2) [cells]."""
    steps = np.abs(np.diff(cells, axis=0)).sum(axis=1)
    return float(np.count_nonzero(steps == 1) + SQRT2 * np.count_nonzero(steps == 2))


@compiled
def _begin(
    reached: NDArray[np.float64],
    buckets: NDArray[np.int32],
    links: NDArray[np.int32],
    paid: NDArray[np.float64],
    state: NDArray[np.int64],
    begin: int,
) -> None:
    """Put the start into the first bucket."""
    reached[begin] = 1.0
    links[0, 0], links[1, 0], paid[0] = begin, -1, 1.0
    buckets[0] = 0
    state[_LIVE], state[_USED], state[_SPARE] = 1, 1, -1


@compiled
def _estimate(rows: int, columns: int, guided: bool) -> float:
    """Return the length of the shortest path without obstacles [cells]; 0 unless guided."""
    if not guided:
        return 0.0
    rows, columns = abs(rows), abs(columns)
    return rows + columns - (2.0 - SQRT2) * min(rows, columns)


@compiled
@borrows
def _expand(
    costs: NDArray[np.uint8],
    factors: NDArray[np.float64],
    reached: NDArray[np.float64],
    came: NDArray[np.int8],
    buckets: NDArray[np.int32],
    links: NDArray[np.int32],
    paid: NDArray[np.float64],
    state: NDArray[np.int64],
    width: int,
    begin: int,
    end: int,
    rule: int,
    guided: bool,
    piece: int,
) -> int:
    """Expand up to `piece` cells; return whether the search continues, needs room, or has ended.

    `links` holds the cell of each entry and the next entry of its bucket; entries that were taken
    out are chained from `state[_SPARE]` and used again, which keeps the list in the cache.
    """
    count, size = len(buckets), links.shape[1]
    goal_row, goal_column = end // width, end % width
    least = _estimate(begin // width - goal_row, begin % width - goal_column, guided)
    last = state[_EXPANDED] + piece
    while state[_LIVE] > 0:
        if reached[end] > 0.0 and least + state[_BUCKET_NOW] * _BUCKET >= reached[end] - 1.0:
            break
        slot = state[_BUCKET_NOW] % count
        entry = buckets[slot]
        if entry < 0:
            state[_BUCKET_NOW] += 1
            continue
        if state[_EXPANDED] >= last:
            return _GOING_ON
        if size - state[_USED] < 8:
            return _POOL_FULL
        cell, cost = links[0, entry], paid[entry]
        buckets[slot] = links[1, entry]
        links[1, entry] = state[_SPARE]
        state[_SPARE] = entry
        state[_LIVE] -= 1
        if cost > reached[cell]:
            continue  # a shorter path to it has been found since
        state[_EXPANDED] += 1
        row, column = cell // width, cell % width
        for direction in range(8):
            row_step, column_step = _ROW_STEPS[direction], _COLUMN_STEPS[direction]
            to = cell + row_step * width + column_step
            known = reached[to]
            # No step costs less than its length: most neighbours need no look at the map.
            if 0.0 < known <= cost + _LENGTHS[direction]:
                continue
            new = cost + _step_cost(costs, factors, cell, row_step * width, column_step, rule)
            if new == np.inf or 0.0 < known <= new:
                continue
            reached[to] = new
            came[to] = direction
            left = _estimate(row + row_step - goal_row, column + column_step - goal_column, guided)
            _put(buckets, links, paid, state, to, new, new - 1.0 - least + left)
    return _ENDED


@compiled
@borrows
def _step_cost(
    costs: NDArray[np.uint8],
    factors: NDArray[np.float64],
    cell: int,
    down: int,
    right: int,
    rule: int,
) -> float:
    """Return the cost of the step to a neighbour; inf if it is not allowed."""
    factor: float = factors[costs[cell + down + right]]
    if down == 0 or right == 0 or factor == np.inf:
        return factor
    across, along = factors[costs[cell + right]], factors[costs[cell + down]]
    return SQRT2 * factor if (across < np.inf) + (along < np.inf) >= rule else np.inf


@compiled
@borrows
def _put(
    buckets: NDArray[np.int32],
    links: NDArray[np.int32],
    paid: NDArray[np.float64],
    state: NDArray[np.int64],
    cell: int,
    cost: float,
    estimate: float,
) -> None:
    """Put a cell into the bucket of its estimate."""
    slot = max(int(estimate / _BUCKET), state[_BUCKET_NOW]) % len(buckets)
    entry = state[_SPARE]
    if entry >= 0:
        state[_SPARE] = links[1, entry]
    else:
        entry = state[_USED]
        state[_USED] += 1
    links[0, entry], links[1, entry], paid[entry] = cell, buckets[slot], cost
    buckets[slot] = entry
    state[_LIVE] += 1


@compiled
def _path(came: NDArray[np.int8], width: int, begin: int, end: int) -> NDArray[np.int64]:
    """Return the cells (n, 2) from start to goal by the direction in which each was reached."""
    count, cell = 1, end
    while cell != begin:
        cell -= _ROW_STEPS[came[cell]] * width + _COLUMN_STEPS[came[cell]]
        count += 1
    cells = np.empty((count, 2), np.int64)
    cell = end
    for at in range(count - 1, -1, -1):
        cells[at, 0], cells[at, 1] = cell // width - 1, cell % width - 1
        cell -= _ROW_STEPS[came[cell]] * width + _COLUMN_STEPS[came[cell]]
    return cells
