"""Doors of a map cost a way of their own."""

import math
from pathlib import Path

import numpy as np
import pytest

from robotctl.maps.localisation_map import load_any_map
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.planning.map.doors import NO_DOORS, Doors, doors_of
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.map.zones import Closed, path_prices
from robotctl.planning.path.global_planning.plan import PlannerConfig
from robotctl.planning.path.global_planning.planners import PLANNERS
from tests.planning.behave.journey.bench import BODY, SIDE_M, room, two_rooms


def test_the_doors_of_the_office_are_where_its_walls_have_them():
    grid = load_any_map("office", Path()).grid
    doors = doors_of(grid, 0.2, 5.0)
    # The gaps of configs/worlds/office.toml in the walls on both sides of its corridor.
    south, north = (2.53, 9.02, 15.02, 22.02), (3.03, 8.52, 14.02, 19.53, 24.02)
    wanted = [*((x, 8.62) for x in south), *((x, 6.32) for x in north)]
    assert len(doors.places) == len(wanted)
    assert doors.away_m(np.array(wanted)).max() < 0.1


def test_without_a_price_or_a_map_no_doors_are_looked_for():
    grid = GridMap(two_rooms(0.9), SIDE_M)
    assert doors_of(grid, 0.15, 0.0) is NO_DOORS
    assert doors_of(None, 0.15, 5.0) is NO_DOORS
    assert len(doors_of(grid, 0.15, 5.0).places) == 1


def test_a_wide_opening_is_no_door():
    assert not len(doors_of(GridMap(two_rooms(2.0), SIDE_M), 0.15, 5.0).places)


@pytest.mark.parametrize("heading_deg", [0.0, 30.0, 90.0])
def test_a_straight_way_through_a_door_costs_so_much_more(heading_deg):
    grid = GridMap(np.zeros((80, 80), np.int8), SIDE_M)
    prices = Doors(np.array([[2.025, 2.025]]), 6.0).prices(grid)
    step_m = 0.001
    along_m = np.arange(-1.9, 1.9, step_m)
    c, s = math.cos(math.radians(heading_deg)), math.sin(math.radians(heading_deg))
    rows, columns = grid.cell_of(np.column_stack([2.025 + c * along_m, 2.025 + s * along_m])).T
    assert step_m * (prices[rows, columns] - 1.0).sum() == pytest.approx(6.0, rel=0.1)


@pytest.mark.parametrize("heading_rad", [0.0, 1.0])
def test_a_door_is_priced_where_it_is_on_a_map_that_is_turned(heading_rad):
    origin = SE2(-3.0, 1.0, heading_rad)
    grid = GridMap(np.zeros((80, 80), np.int8), SIDE_M, origin)
    x_m, y_m = origin.apply(1.0, 3.0)
    prices = Doors(np.array([[x_m, y_m]]), 6.0).prices(grid)
    rows, columns = np.nonzero(prices > 1.0)
    middle = grid.centre_of(np.column_stack([rows, columns])).mean(axis=0)
    assert middle == pytest.approx([x_m, y_m], abs=SIDE_M)


def long_way_round():
    """Return a room whose two halves are joined by a door below, and a wide opening above."""
    cells = room(6.0, 8.0)
    cells[:, 60] = 100
    cells[12:28, 60] = 0  # about y = 1 m, 0.8 m wide
    cells[100:158, 60] = 0  # 2.9 m wide, and 4 m farther
    return GridMap(cells, SIDE_M)


@pytest.mark.parametrize("planner", ["astar", "hybrid"])
@pytest.mark.parametrize(("door_m", "through_door"), [(0.0, True), (2.0, True), (9.0, False)])
def test_with_dear_doors_a_longer_way_without_one_is_taken(planner, door_m, through_door):
    grid = long_way_round()
    closed = Closed(doors=doors_of(grid, BODY.inscribed_m, door_m))
    space = PlanningMap(grid, BODY)
    space.slowness = path_prices(grid, closed, None, 1.0)
    plan = PLANNERS[planner](PlannerConfig()).plan(space, SE2(1.0, 1.0), SE2(5.0, 1.0))
    assert bool(plan.poses[:, 1].max() < 3.0) is through_door
