"""Shortest paths over cells, against published lengths and against scipy's Dijkstra."""

import gzip
import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from robotctl.planning.path.global_planning.grid_search import (
    LETHAL,
    octile_length,
    search_cells,
)

FREE_OR_NOT = np.where(np.arange(256) < 253, 1.0, math.inf)
ALL_SAME = 1.7 * FREE_OR_NOT
FACTORS = np.where(np.arange(256) < 253, 1.0 + np.arange(256) / 50.0, math.inf)
NEEDED = {"both": 2, "one": 1, "none": 0}
MAPS = ("arena", "den312d", "lak303d", "orz103d", "32room_000")


def oracle(costs, factors, start, goal, corners):
    """Return the least cost by another algorithm on an explicit graph."""
    rows, columns = costs.shape
    price = factors[costs]
    edges = []
    for row in range(rows):
        for column in range(columns):
            for down in (-1, 0, 1):
                for right in (-1, 0, 1):
                    r, c = row + down, column + right
                    if (down, right) == (0, 0) or not (0 <= r < rows and 0 <= c < columns):
                        continue
                    beside = int(price[row, c] < math.inf) + int(price[r, column] < math.inf)
                    if down and right and beside < NEEDED[corners]:
                        continue
                    if math.isfinite(price[row, column] + price[r, c]):
                        length = math.hypot(down, right) * price[r, c]
                        edges.append((row * columns + column, r * columns + c, length))
    if not edges:
        return 0.0 if start == goal and math.isfinite(price[start]) else math.inf
    origin, target, length = zip(*edges, strict=True)
    graph = coo_array((length, (origin, target)), (rows * columns,) * 2).tocsr()
    if not (math.isfinite(price[start]) and math.isfinite(price[goal])):
        return math.inf
    distances = dijkstra(graph, indices=start[0] * columns + start[1])
    return float(distances[goal[0] * columns + goal[1]])


@given(st.data())
def test_paths_cost_what_an_explicit_graph_says(data):
    rows, columns = data.draw(st.integers(1, 9)), data.draw(st.integers(1, 9))
    seed = data.draw(st.integers(0, 2**32 - 1))
    corners = data.draw(st.sampled_from(tuple(NEEDED)))
    rng = np.random.default_rng(seed)
    costs = rng.integers(0, 253, (rows, columns)).astype(np.uint8)
    costs[rng.random((rows, columns)) < data.draw(st.floats(0.0, 0.6))] = LETHAL
    start, goal = ((int(rng.integers(rows)), int(rng.integers(columns))) for _ in range(2))
    factors = data.draw(st.sampled_from((FACTORS, ALL_SAME)))
    check(costs, factors, start, goal, corners)


def check(costs, factors, start, goal, corners):
    """Compare A* and Dijkstra's algorithm with the oracle."""
    expected = oracle(costs, factors, start, goal, corners)
    for guided in (True, False):
        found = search_cells(costs, factors, start, goal, corners=corners, guided=guided)
        assert found.cost == pytest.approx(expected)
        if math.isfinite(expected):
            check_path(found.cells, factors[costs], start, goal, corners, found.cost)


def check_path(cells, price, start, goal, corners, cost):
    """Walk along a path: it leads from start to goal, keeps the rule and costs what is said."""
    assert tuple(cells[0]) == start
    assert tuple(cells[-1]) == goal
    spent = 0.0
    for (row, column), (r, c) in pairwise(cells):
        assert max(abs(r - row), abs(c - column)) == 1
        if row != r and column != c:
            beside = int(price[row, c] < math.inf) + int(price[r, column] < math.inf)
            assert beside >= NEEDED[corners]
        spent += math.hypot(r - row, c - column) * price[r, c]
    assert spent == pytest.approx(cost)


def noise(rng):
    """Return a map of which 30 % are obstacles."""
    return np.where(rng.random((40, 70)) < 0.3, LETHAL, 0).astype(np.uint8)


def boxes(rng):
    """Return a map with rectangles."""
    costs = np.zeros((40, 70), np.uint8)
    for row, column, height, width in rng.integers((0, 0, 2, 2), (38, 68, 12, 12), (12, 4)):
        costs[row : row + height, column : column + width] = LETHAL
    return costs


def comb(rng):
    """Return a map with corridors longer than a jump, each joined to the next at some row."""
    costs = np.zeros((70, 40), np.uint8)
    walls = np.arange(4, 40, 5)
    costs[:, walls] = LETHAL
    costs[rng.integers(0, 70, len(walls)), walls] = 0
    return costs


@pytest.mark.parametrize("corners", NEEDED)
@pytest.mark.parametrize("make", [noise, boxes, comb])
def test_jumps_lose_no_shortest_path(make, corners):
    rng = np.random.default_rng(51)
    for _ in range(4):
        costs = make(rng)
        start, goal = map(tuple, rng.choice(np.argwhere(costs == 0), 2).tolist())
        check(costs, FREE_OR_NOT, start, goal, corners)


def text(path):
    """Return the lines of a packed file."""
    return gzip.decompress(path.read_bytes()).decode().splitlines()


def moving_ai(folder, name):
    """Return costs and problems (start, goal, published length and half of its last digit)."""
    lines = text(folder / f"{name}.map.gz")[4:]
    costs = np.array([[0 if c == "." else LETHAL for c in line] for line in lines], np.uint8)
    problems = []
    for line in text(folder / f"{name}.map.scen.gz")[1:]:
        if not (words := line.split("\t"))[4:]:
            continue
        x0, y0, x1, y1 = map(int, words[4:8])
        digits = len(words[8].partition(".")[2])
        problems.append(((y0, x0), (y1, x1), float(words[8]), 0.5 * 10.0**-digits))
    return costs, problems


@pytest.mark.recordings("movingai")
@pytest.mark.parametrize("name", MAPS)
def test_published_lengths_are_matched(recordings, name):
    costs, problems = moving_ai(recordings / "movingai", name)
    for start, goal, published, rounding in problems[:: max(1, len(problems) // 300)]:
        found = search_cells(costs, FREE_OR_NOT, start, goal)
        assert found.cost == pytest.approx(published, abs=max(1e-3, 1.01 * rounding))
        assert octile_length(found.cells) == pytest.approx(found.cost)


def test_the_search_is_asked_whether_there_is_time_and_ends():
    asked = []
    costs = np.zeros((700, 700), np.uint8)
    costs[350, 1:] = LETHAL
    costs[:, 699] = LETHAL
    costs[0, 600] = LETHAL
    found = search_cells(
        costs, FACTORS, (0, 650), (699, 650), goes_on=lambda: bool(asked.append(1))
    )
    assert (len(asked), found.in_time, len(found.cells)) == (1, False, 0)
    assert 10_000 <= found.expanded < 20_000


def test_a_long_search_needs_no_more_room_than_it_gets():
    """Noise with much open list: the pool grows under way, and the path is the oracle's."""
    rng = np.random.default_rng(4)
    costs = rng.integers(0, 253, (120, 120)).astype(np.uint8)
    found = search_cells(costs, FACTORS, (0, 0), (119, 119), guided=False)
    assert found.cost == pytest.approx(oracle(costs, FACTORS, (0, 0), (119, 119), "both"))
    assert found.expanded >= 120 * 120 - 1


@pytest.mark.parametrize(
    ("start", "goal", "factors", "said"),
    [
        ((0, 5), (0, 0), FREE_OR_NOT, "start 0, 5 lies outside of 3 rows x 4"),
        ((0, 0), (-1, 0), FREE_OR_NOT, "goal -1, 0 lies outside"),
        ((0, 0), (1, 1), 0.5 * FREE_OR_NOT, "at least 1"),
        ((0, 0), (1, 1), np.ones(256), "inf for 254"),
    ],
)
def test_what_cannot_be_searched_is_refused(start, goal, factors, said):
    with pytest.raises(ValueError, match=said):
        search_cells(np.zeros((3, 4), np.uint8), factors, start, goal)
