"""Straight pieces in place of steps: never nearer to a wall, never longer."""

import math
from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from robotctl.planning.map.planning_map import clearance_of
from robotctl.planning.path.global_planning.grid_search import search_cells
from robotctl.planning.path.global_planning.smoothing import straightened

PRICES = np.where(np.arange(256) < 253, 1.0, math.inf)


def nearest_along(clearance, a, b):
    """Return the least clearance of the cells along a line, by a dense walk."""
    share = np.linspace(0.0, 1.0, 4001)[:, np.newaxis]
    cells = np.floor(a + 0.5 + share * (b - a)).astype(int)
    return clearance[tuple(cells.T)].min()


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.35))
def test_a_straight_piece_is_no_nearer_to_walls_than_the_steps_it_stands_for(seed, density):
    rng = np.random.default_rng(seed)
    blocked = rng.random((30, 30)) < density
    blocked[0, 0] = blocked[-1, -1] = False
    costs = np.where(blocked, 254, 0).astype(np.uint8)
    cells = search_cells(costs, PRICES, (0, 0), (29, 29)).cells
    if not len(cells):
        return
    clearance = clearance_of(blocked)
    corners = straightened(cells[:, ::-1] + 0.5, clearance, np.where(blocked, math.inf, 1.0))
    assert (corners[0], corners[-1]) == (0, len(cells) - 1)
    assert (np.diff(corners) > 0).all()
    for first, last in pairwise(corners):
        if last == first + 1:
            continue
        steps = cells[first : last + 1]
        a, b = steps[0].astype(float), steps[-1].astype(float)
        assert nearest_along(clearance, a, b) >= clearance[tuple(steps.T)].min()
        assert math.dist(a, b) <= np.hypot(*np.diff(steps, axis=0).T).sum() + 1e-9


def test_an_empty_map_needs_one_piece_and_a_corner_two():
    empty = np.zeros((20, 30), bool)
    cells = search_cells(empty.astype(np.uint8), PRICES, (2, 3), (17, 25)).cells
    assert straightened(
        cells[:, ::-1] + 0.5, clearance_of(empty), np.ones(empty.shape)
    ).tolist() == [
        0,
        len(cells) - 1,
    ]


def test_a_detour_that_costs_more_than_it_saves_is_not_straightened():
    blocked = np.zeros((21, 41), bool)
    prices = np.ones(blocked.shape)
    prices[8:13, 10:30] = 50.0
    cells = np.array(
        [(10 - i, 5 + i) for i in range(6)]
        + [(5, c) for c in range(11, 30)]
        + [(5 + i, 29 + i) for i in range(1, 6)]
    )
    corners = straightened(cells[:, ::-1] + 0.5, clearance_of(blocked), prices)
    assert len(corners) > 2
