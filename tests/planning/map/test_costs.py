"""What a place costs, against bodies turned every way."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.planning.map.costs import costs_of
from robotctl.planning.map.planning_map import PlanningMap

BODY = Footprint(((0.5, -0.2), (0.5, 0.2), (-0.2, 0.2), (-0.2, -0.2)))
HEADINGS = np.linspace(-math.pi, math.pi, 48, endpoint=False)
ORIGIN = SE2(3.0, -1.0, 0.4)


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(20, 27), st.integers(20, 27))
def test_where_no_heading_is_free_a_place_costs_most_and_with_room_nothing(seed, rows, columns):
    rng = np.random.default_rng(seed)
    cells = np.where(rng.random((rows, columns)) < 0.05, 100, 0).astype(np.int8)
    space = PlanningMap(GridMap(cells, 0.1, ORIGIN), BODY)
    costs = costs_of(space, comfort_m=0.3)
    assert costs.shape == (rows // 2, columns // 2)
    assert costs.resolution_m == 0.2
    assert costs.origin == ORIGIN
    for row, column in np.argwhere(costs.cells >= 0):
        # The four cells that it stands for, each at its middle.
        x, y = np.meshgrid(2 * column + np.array([0.5, 1.5]), 2 * row + np.array([0.5, 1.5]))
        places = np.stack([x.ravel(), y.ravel()], axis=1)
        poses = np.array([(*place, heading) for place in places for heading in HEADINGS])
        touches = space.collides(poses).reshape(4, -1)
        cost = costs.cells[row, column]
        if touches.all(axis=1).any() and not _nearly(space, places):
            assert cost == 100
        if cost == 0:  # all four have the body's inner circle and 0.3 m around it
            assert space.gaps_m(poses).reshape(4, -1).max(axis=1).min() > 0.0


def _nearly(space, places):
    """Return whether one of the places is within a cell of where the inner circle touches."""
    cells = np.floor(places).astype(int)
    clearance = space.clearance[cells[:, 1], cells[:, 0]]
    return bool((np.abs(clearance - space.inscribed) < 1.5).any())


def test_costs_fall_from_what_blocks_and_what_nobody_knows_has_none():
    cells = np.zeros((4, 80), np.int8)
    cells = np.vstack([cells] * 20)
    cells[:, 0] = 100
    cells[:, 78:] = -1
    space = PlanningMap(GridMap(cells, 0.05), BODY, through_unknown=True)
    row = costs_of(space, comfort_m=0.4).cells[20, :-4].astype(int)
    middle = row[: len(row) // 2]
    assert middle[0] == 100
    assert (np.diff(middle) <= 0).all()
    # 0.2 m of body, 0.4 m of comfort: nothing from 0.65 m on.
    assert middle[math.ceil(0.65 / 0.1)] == 0
    assert costs_of(space, comfort_m=0.4).cells[20, 39] in {-1, 100}
