"""Shortest paths over cells that have costs: Dijkstra's algorithm and A*.

Each step goes to one of eight neighbours and costs its length, 1 or sqrt(2) cells, times the
factor of the cell it leads to. A* (Hart, Nilsson, Raphael 1968) is led by the octile distance, the
length of the shortest path without obstacles, which never overestimates since no factor is below 1.

A table says, for the step into a cell and its free neighbours, where a best path may go on. Where
all free cells have one factor, of paths that cost the same only that with its diagonal steps first
is followed (jump point search: Harabor, Grastien 2011), and cells from which it only goes straight
on are passed without an entry in the open list.

The open list is of buckets (Dial 1969): entries whose estimates differ by less than a bucket's
width come in no order, so a cell may be expanded again by a shorter path; the search ends when no
bucket can hold a shorter one to the goal, and is exact. It works in pieces, so that its caller can
watch the time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Final, Literal, NamedTuple, TypeAlias

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
_PIECE: Final = 10_000
"""Cells expanded between two looks at the time: 1 to 5 ms."""
_JUMP: Final = 32
"""Maximum cells of a jump, of which a path keeps 5 bits."""
_TIE: Final = 1e-7
"""Difference between two lengths [cells] below which it is that of rounding."""
_NOT_NEGATIVE: Final = (1 << 31) - 1
"""Mask that tells the compiler that an index is not negative, which spares a test."""
_GOING_ON, _POOL_FULL, _ENDED = 0, 1, 2
_BUCKET_NOW, _LIVE, _USED, _SPARE, _EXPANDED = range(5)
"""Places in the state of a search."""

_STEPS: Final = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1))
"""Rows and columns of the eight steps, in the order of the bits of a mask."""
_LENGTHS: Final = np.array([math.hypot(*step) for step in _STEPS])
_LOWEST: Final = np.array([(mask & -mask).bit_length() - 1 for mask in range(256)])
"""Lowest bit of each mask."""


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
    search = _begin(padded, factors, _RULES[corners], begin)
    status, in_time = _GOING_ON, True
    while status != _ENDED:
        status = _expand(search, width, begin, end, guided, _PIECE)
        if status == _POOL_FULL:
            links, paid = search.links, search.paid
            search = search._replace(
                links=np.concatenate([links, np.empty_like(links)], axis=1),
                paid=np.concatenate([paid, np.empty_like(paid)]),
            )
        elif status == _GOING_ON and not goes_on():
            in_time = False
            break
    expanded = int(search.state[_EXPANDED])
    if search.reached[end] == 0.0 or not in_time:
        return CellPath(np.empty((0, 2), np.int64), math.inf, expanded, in_time)
    cells = _path(search.found, search.offsets, width, begin, end)
    return CellPath(cells, search.reached[end] - 1.0, expanded)


class _Search(NamedTuple):
    """Arrays of a search, as compiled code takes them; those of cells are flat, with a rim."""

    costs: NDArray[np.uint8]
    factors: NDArray[np.float64]
    masks: NDArray[np.uint8]
    """Free neighbours of each cell."""
    follow: NDArray[np.uint8]
    """Steps onward by a cell's last step and mask."""
    offsets: NDArray[np.int64]
    """Cells on in the map for each step."""
    reached: NDArray[np.float64]
    """Cost to each cell + 1, as a page of zeros costs nothing until it is touched; 0: not yet."""
    found: NDArray[np.uint16]
    """Steps onward from each cell (8 bits), the step that led there (3 bits), and the cells of that
    jump - 1."""
    buckets: NDArray[np.int32]
    """First entry of each."""
    links: NDArray[np.int32]
    """Cell of each entry and the next entry of its bucket; those taken out form a list as well and
    are used again, which keeps the open list in the cache."""
    paid: NDArray[np.float64]
    """Cost + 1 of each entry."""
    state: NDArray[np.int64]
    uniform: float
    """Factor of all free cells; 0: they differ."""


def _begin(
    padded: NDArray[np.uint8], factors: NDArray[np.float64], corners: int, begin: int
) -> _Search:
    """Return a search with the start in its first bucket."""
    finite = factors[factors < math.inf]
    uniform = float(finite[0]) if finite.min() == finite.max() else 0.0
    span = int(2.0 * SQRT2 * finite.max() * (_JUMP if uniform else 1) / _BUCKET) + 3
    search = _Search(
        padded.ravel(),
        factors,
        _free_neighbours(padded, factors < math.inf),
        _directions(corners, uniform > 0.0),
        np.array([row * padded.shape[1] + column for row, column in _STEPS]),
        np.zeros(padded.size),
        np.zeros(padded.size, np.uint16),
        np.full(1 << span.bit_length(), -1, np.int32),
        np.empty((2, 1024), np.int32),
        np.empty(1024),
        np.zeros(5, np.int64),
        uniform,
    )
    search.state[_SPARE] = -1
    search.reached[begin], search.found[begin] = 1.0, search.follow[-1, search.masks[begin]]
    _put(search, begin, 1.0, 0.0)
    return search


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


@cache
def _directions(corners: int, is_uniform: bool) -> NDArray[np.uint8]:
    """Return where a best path goes on, (9, 256) masks of steps, by a cell's last step and mask.

    A step is left out if the cell before leads there past this cell for less, or, where all factors
    are the same, for the same with the diagonal step first. The straight step after that is never
    left out for the same, so that it does not matter which of several best paths to a cell is kept.
    The last row is of the start.
    """
    bits = np.arange(256)
    free = {step: bits >> k & 1 for k, step in enumerate(_STEPS)}
    free[0, 0] = np.ones_like(bits)

    def allowed(here: tuple[int, int], to: tuple[int, int]) -> NDArray[np.bool_]:
        if max(abs(to[0] - here[0]), abs(to[1] - here[1])) != 1:
            return np.zeros(256, np.bool_)
        is_straight = here[0] == to[0] or here[1] == to[1]
        beside = free[here[0], to[1]] + free[to[0], here[1]]
        return (free[to] > 0) & (is_straight | (beside >= corners))

    follow = np.zeros((9, 256), np.uint8)
    for last, (down, right) in enumerate((*_STEPS, (0, 0))):
        before = -down, -right
        for k, to in enumerate(_STEPS):
            taken = allowed((0, 0), to) & (last == 8 or math.dist(before, to) > 1.0)
            if last < 8 and is_uniform:
                taken &= ~allowed(before, to) & (before != to)
                first, both = _LENGTHS[last], _LENGTHS[last] + _LENGTHS[k]
                for by in set(_STEPS) - {before, to}:
                    other = math.dist(before, by)
                    saved = both - other - math.dist(by, to)
                    if saved > _TIE or (saved > -_TIE and other > first):
                        taken &= ~(allowed(before, by) & allowed(by, to))
            follow[last] |= (taken << k).astype(np.uint8)
    return follow


@compiled
def _free_neighbours(costs: NDArray[np.uint8], is_free: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return the mask of each cell's free neighbours, flat; 0 at the rim."""
    rows, columns = costs.shape
    free = np.empty((rows, columns), np.uint8)
    for row in range(rows):
        line, source = free[row], costs[row]
        for i in range(columns):
            line[i] = is_free[source[i]]
    masks = np.zeros((rows, columns), np.uint8)
    for row in range(1, rows - 1):
        to = masks[row, 1:-1]
        above, here, below = free[row - 1], free[row], free[row + 1]
        north_west, north, north_east = above[:-2], above[1:-1], above[2:]
        west, east = here[:-2], here[2:]
        south_west, south, south_east = below[:-2], below[1:-1], below[2:]
        for i in range(columns - 2):
            to[i] = (
                east[i] | west[i] << 1 | south[i] << 2 | north[i] << 3
                | south_east[i] << 4 | south_west[i] << 5 | north_east[i] << 6 | north_west[i] << 7
            )  # fmt: skip
    return masks.ravel()


@compiled
def _estimate(rows: int, columns: int, guided: bool) -> float:
    """Return the length of the shortest path without obstacles [cells]; 0 unless guided."""
    if not guided:
        return 0.0
    rows, columns = abs(rows), abs(columns)
    return rows + columns - (2.0 - SQRT2) * min(rows, columns)


@compiled
@borrows
def _expand(search: _Search, width: int, begin: int, end: int, guided: bool, piece: int) -> int:
    """Expand up to `piece` cells; return whether the search continues, needs room, or has ended."""
    state, reached, buckets, links = search.state, search.reached, search.buckets, search.links
    least = _estimate(begin // width - end // width, begin % width - end % width, guided)
    last = state[_EXPANDED] + piece
    while state[_LIVE] > 0:
        if reached[end] > 0.0 and least + state[_BUCKET_NOW] * _BUCKET >= reached[end] - 1.0:
            break
        slot = state[_BUCKET_NOW] & len(buckets) - 1
        entry = buckets[slot]
        if entry < 0:
            state[_BUCKET_NOW] += 1
            continue
        if state[_EXPANDED] >= last:
            return _GOING_ON
        if links.shape[1] - state[_USED] < 8:
            return _POOL_FULL
        cell, cost = links[0, entry] & _NOT_NEGATIVE, search.paid[entry]
        buckets[slot] = links[1, entry]
        links[1, entry] = state[_SPARE]
        state[_SPARE] = entry
        state[_LIVE] -= 1
        if cost <= reached[cell]:  # no shorter path to it has been found since
            state[_EXPANDED] += 1
            _expand_cell(search, width, end, guided, cell, cost, 1.0 + least)
    return _ENDED


@compiled
@borrows
def _expand_cell(
    search: _Search, width: int, end: int, guided: bool, cell: int, cost: float, least: float
) -> None:
    """Go on from a cell, in each direction to the next cell with more than one way on."""
    follow, masks, reached, found = search.follow, search.masks, search.reached, search.found
    longest = _JUMP if search.uniform > 0.0 else 1
    row, column = cell // width - end // width, cell % width - end % width
    left = np.int64(found[cell] & 255)
    while left > 0:
        direction = _LOWEST[left]
        left &= left - 1
        by = search.offsets[direction]
        to, jump = cell + by & _NOT_NEGATIVE, 1
        # No step costs less than its length: most neighbours need no look at the map.
        if 0.0 < reached[to] <= cost + _LENGTHS[direction]:
            continue
        onward = follow[direction, masks[to]]
        while onward == 1 << direction and jump < longest and to != end:
            to = to + by & _NOT_NEGATIVE
            jump += 1
            onward = follow[direction, masks[to]]
        if onward == 0 and to != end:
            continue
        factor = search.uniform if search.uniform > 0.0 else search.factors[search.costs[to]]
        new = cost + jump * _LENGTHS[direction] * factor
        if reached[to] == 0.0 or new < reached[to]:
            reached[to], found[to] = new, direction << 8 | jump - 1 << 11 | onward
            down, right = _STEPS[direction]
            ahead = _estimate(row + jump * down, column + jump * right, guided)
            _put(search, to, new, new - least + ahead)


@compiled
@borrows
def _put(search: _Search, cell: int, cost: float, estimate: float) -> None:
    """Put a cell into the bucket of its estimate."""
    state, links, buckets = search.state, search.links, search.buckets
    slot = max(int(estimate / _BUCKET), state[_BUCKET_NOW]) & len(buckets) - 1
    entry = state[_SPARE]
    if entry >= 0:
        state[_SPARE] = links[1, entry]
    else:
        entry = state[_USED]
        state[_USED] += 1
    links[0, entry], links[1, entry], search.paid[entry] = cell, buckets[slot], cost
    buckets[slot] = entry
    state[_LIVE] += 1


@compiled
def _path(
    found: NDArray[np.uint16], offsets: NDArray[np.int64], width: int, begin: int, end: int
) -> NDArray[np.int64]:
    """Return the cells (n, 2) from start to goal by the jump with which each was reached."""
    count, cell = 1, end
    while cell != begin:
        jump = (found[cell] >> 11) + 1
        cell -= jump * offsets[found[cell] >> 8 & 7]
        count += jump
    cells = np.empty((count, 2), np.int64)
    cells[0] = begin // width - 1, begin % width - 1
    cell, at = end, count - 1
    while cell != begin:
        step, jump = offsets[found[cell] >> 8 & 7], (found[cell] >> 11) + 1
        for _ in range(jump):
            cells[at] = cell // width - 1, cell % width - 1
            cell -= step
            at -= 1
    return cells
