from __future__ import annotations

import math

import numpy as np
import pytest

from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import FREE, OCCUPIED, UNKNOWN, GridMap
from robotctl.planning.map.cost_map import (
    FREE_COST,
    INSCRIBED,
    LETHAL,
    NO_INFORMATION,
    CostMapConfig,
    cost_map,
)


def random_grid(seed):
    rng = np.random.default_rng(seed)
    cells = rng.choice(
        np.array([FREE, UNKNOWN, OCCUPIED, 64, 65], np.int8),
        (30, 40),
        p=[0.78, 0.2, 0.01, 0.005, 0.005],
    )
    return GridMap(cells, 0.1, SE2(1.0, -2.0, 0.3))


def loop_cost(grid, row, column, config):
    """Return one cell's cost by trying every obstacle."""
    obstacles = np.argwhere(grid.cells >= config.occupied_percent)
    distance_m = min(math.hypot(row - r, column - c) * grid.resolution_m for r, c in obstacles)
    if distance_m == 0.0:
        return LETHAL
    if distance_m <= config.robot_radius_m + 1e-9:
        return INSCRIBED
    if grid.cells[row, column] == UNKNOWN:
        return NO_INFORMATION
    if distance_m > config.inflation_radius_m + 1e-9:
        return FREE_COST
    return int(252 * math.exp(-config.scaling_per_m * (distance_m - config.robot_radius_m)))


@pytest.mark.parametrize("seed", range(3))
def test_every_cost_is_that_of_the_nearest_obstacle(seed):
    grid = random_grid(seed)
    config = CostMapConfig(robot_radius_m=0.3, inflation_radius_m=0.7, scaling_per_m=4.0)
    costs = cost_map(grid, config).costs
    expected = [[loop_cost(grid, row, column, config) for column in range(40)] for row in range(30)]
    np.testing.assert_array_equal(costs, expected)
    assert {FREE_COST, INSCRIBED, LETHAL, NO_INFORMATION} <= set(np.unique(costs).tolist())


def test_costs_never_rise_away_from_a_wall():
    cells = np.full((5, 60), FREE, np.int8)
    cells[:, 0] = OCCUPIED
    line = cost_map(GridMap(cells, 0.05)).costs[2].astype(int)
    assert np.all(np.diff(line) <= 0)
    assert line[0] == LETHAL
    assert np.all(line[1:6] == INSCRIBED)
    assert np.all(line[12:] == FREE_COST)
    assert 0 < line[11] < line[6] < INSCRIBED


def test_a_map_without_obstacles_costs_nothing_where_it_is_known():
    cells = np.array([[FREE, UNKNOWN]], np.int8)
    assert cost_map(GridMap(cells, 0.05)).costs.tolist() == [[FREE_COST, NO_INFORMATION]]


def test_costs_are_found_by_places_in_the_world_and_outside_nothing_is_known():
    grid = random_grid(1)
    costs = cost_map(grid)
    cells = np.array([[0, 0], [29, 39], [7, 31]])
    np.testing.assert_array_equal(costs.cost_at(grid.centre_of(cells)), costs.costs[tuple(cells.T)])
    outside = grid.centre_of(np.array([[-1, 0], [0, 40], [30, 5]]))
    assert costs.cost_at(outside).tolist() == [NO_INFORMATION] * 3


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("robot_radius_m", -0.1),
        ("inflation_radius_m", 0.1),
        ("scaling_per_m", math.inf),
        ("occupied_percent", 0),
    ],
)
def test_a_wrong_setting_is_refused_with_its_name_and_value(key, value):
    with pytest.raises(ValueError, match=f"{key} must be .*, found {value}"):
        CostMapConfig(**{key: value})
