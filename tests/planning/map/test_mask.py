"""Masks: the cells that they close, and the speed that they allow, against shapely."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import affinity

from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.planning.map.mask import Mask
from robotctl.planning.map.mask_config import MaskConfig
from robotctl.planning.map.zones import Closed, path_prices, speed_limits

KEEP_OUT = MaskConfig("keep.yaml", "keep_out")


def square(row, column, grid):
    """Return a cell of a map in `world`."""
    side_m, origin = grid.resolution_m, grid.origin
    cell = shapely.box(column * side_m, row * side_m, (column + 1) * side_m, (row + 1) * side_m)
    turned = affinity.rotate(cell, origin.theta_rad, (0, 0), use_radians=True)
    return affinity.translate(turned, origin.x_m, origin.y_m)


@settings(max_examples=60, deadline=None)
@given(
    st.floats(0.02, 0.3),
    st.floats(0.02, 0.3),
    st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-math.pi, math.pi)),
    st.integers(0, 99),
)
def test_a_cell_is_closed_where_the_mask_covers_a_part_of_it_worth_speaking_of(
    map_m, mask_m, pose, seed
):
    rng = np.random.default_rng(seed)
    grid = GridMap(np.zeros((7, 9), np.int8), map_m, SE2(*pose))
    values = rng.choice(np.array([0, 60, 99, 100, -1], np.int8), (6, 8))
    mask = Mask(KEEP_OUT, GridMap(values, mask_m, SE2(0.1, -0.2, 0.3)))
    closed = mask.closed(grid)
    barred = shapely.union_all(
        [square(row, column, mask.grid) for row, column in np.argwhere(values == 100)]
    )
    for row in range(7):
        for column in range(9):
            cell = square(row, column, grid)
            shared = cell.intersection(barred)
            if closed[row, column]:
                assert cell.distance(barred) < 1e-5
            elif not shared.is_empty:  # thinner than the points are apart
                assert not shared.buffer(-0.51 * min(map_m, mask_m)).area


def test_a_wall_of_one_cell_of_a_fine_mask_closes_a_coarse_map():
    values = np.zeros((100, 100), np.int8)
    values[:, 37] = 100
    closed = Mask(KEEP_OUT, GridMap(values, 0.01)).closed(GridMap(np.zeros((10, 10), np.int8), 0.1))
    assert closed.any(axis=0).tolist() == [False] * 3 + [True] + [False] * 6
    assert closed[:, 3].all()


def test_speeds_are_those_of_nav2s_formula():
    values = np.array([[0, 1, 25, 100, -1]], np.int8)
    grid = GridMap(np.zeros((1, 5), np.int8), 0.1)
    percent = Mask(MaskConfig("a", "speed_percent", 101.0, -1.0), GridMap(values, 0.1))
    assert percent.limits(grid, 2.0)[0] == pytest.approx([math.inf, 2.0, 1.52, 0.02, math.inf])
    absolute = Mask(MaskConfig("b", "speed_m_s", 0.1, 0.01), GridMap(values, 0.1))
    assert absolute.limits(grid, 2.0)[0] == pytest.approx([math.inf, 0.11, 0.35, 1.1, math.inf])
    closed = Closed(masks=(percent, absolute))
    assert not closed.cells(grid).any()
    limits = speed_limits(grid, closed, 2.0)
    assert limits[0] == pytest.approx([math.inf, 0.11, 0.35, 0.02, math.inf])
    assert path_prices(grid, closed, limits, 2.0)[0] == pytest.approx(
        [1.0, 10.0, 2.0 / 0.35, 10.0, 1.0]
    )


def test_beyond_the_mask_nothing_is_closed_and_what_closes_a_cell_has_its_name():
    mask = Mask(KEEP_OUT, GridMap(np.full((2, 2), 100, np.int8), 0.5, SE2(1.0, 1.0)))
    grid = GridMap(np.zeros((30, 30), np.int8), 0.1)
    closed = Closed(masks=(mask,))
    assert np.argwhere(closed.cells(grid)).min() == 10
    assert closed.cells(grid).sum() == 100
    assert closed.what_closes(grid, (12, 12)) == "the keep-out mask keep.yaml"
    assert closed.what_closes(grid, (5, 5)) == ""


@pytest.mark.parametrize(
    ("kind", "base", "multiplier", "said"),
    [
        ("speed_percent", 100.0, -1.0, "a value of 100 means 0 .*above 0, at most 100, is allowed"),
        ("speed_percent", 0.0, 2.0, "a value of 100 means 200"),
        ("speed_m_s", 0.5, -0.01, "a value of 100 means -0.5 .*above 0 is allowed"),
    ],
)
def test_a_speed_that_means_nothing_is_refused(kind, base, multiplier, said):
    values = np.array([[0, 100, -1]], np.int8)
    with pytest.raises(ValueError, match=said):
        Mask(MaskConfig("speed.yaml", kind, base, multiplier), GridMap(values, 0.1))
    Mask(MaskConfig("speed.yaml", kind, base, multiplier), GridMap(np.zeros((1, 2), np.int8), 0.1))


def test_a_value_below_100_makes_a_path_longer_by_a_25th_of_it():
    grid = GridMap(np.zeros((1, 6), np.int8), 0.1)
    values = np.array([[0, 1, 25, 50, 99, -1]], np.int8)
    mask = Mask(KEEP_OUT, GridMap(values, 0.1))
    closed = Closed(masks=(mask,))
    assert not closed.cells(grid).any()
    assert speed_limits(grid, closed, 1.0) is None
    prices = path_prices(grid, closed, None, 1.0)
    assert prices[0] == pytest.approx([1.0, 1.04, 2.0, 3.0, 4.96, 1.0])
    limits = np.array([[0.25, 0.25, 0.25, 0.25, math.inf, math.inf]], np.float32)  # and slow
    assert path_prices(grid, closed, limits, 1.0)[0] == pytest.approx(
        [4.0, 4.16, 8.0, 10.0, 4.96, 1.0]
    )


def test_a_mask_without_such_values_costs_nothing():
    grid = GridMap(np.zeros((1, 3), np.int8), 0.1)
    mask = Mask(KEEP_OUT, GridMap(np.array([[0, 100, -1]], np.int8), 0.1))
    assert path_prices(grid, Closed(masks=(mask,)), None, 1.0) is None


def test_a_fine_line_of_a_mask_counts_in_a_coarse_map():
    values = np.zeros((100, 100), np.int8)
    values[:, 37] = 50
    mask = Mask(KEEP_OUT, GridMap(values, 0.01))
    prices = mask.prices(GridMap(np.zeros((10, 10), np.int8), 0.1))
    assert (prices[:, 3] == 3.0).all()
    assert (np.delete(prices, 3, axis=1) == 1.0).all()


def binary(values, side_m=0.5, origin=None, **meaning):
    config = MaskConfig("masks/camera_off.yaml", "binary", **meaning)
    return Mask(config, GridMap(np.array(values, np.int8), side_m, origin or SE2()))


def test_a_binary_mask_has_an_area_and_closes_nothing():
    mask = binary([[0, 100, 1, -1]])
    assert mask.config.name == "camera_off"
    assert [mask.has(x_m, 0.2) for x_m in (0.2, 0.7, 1.2, 1.7, 2.2, -0.2)] == [0, 1, 1, 0, 0, 0]
    grid = GridMap(np.zeros((2, 8), np.int8), 0.25)
    closed = Closed(masks=(mask,))
    assert not closed.cells(grid).any()
    assert speed_limits(grid, closed, 1.0) is None
    assert path_prices(grid, closed, None, 1.0) is None


def test_what_counts_as_inside_may_be_turned_round():
    mask = binary([[0, 49, 51, 100]], base=1.0, multiplier=-0.01)
    assert [mask.has(x_m, 0.2) for x_m in (0.2, 0.7, 1.2, 1.7)] == [1, 1, 0, 0]


@settings(max_examples=60, deadline=None)
@given(
    st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-math.pi, math.pi)),
    st.tuples(st.floats(-1.0, 3.0), st.floats(-1.0, 3.0)),
    st.integers(0, 99),
)
def test_its_area_is_where_its_cells_are(pose, place, seed):
    values = np.random.default_rng(seed).choice([0, 100], (4, 4))
    mask = binary(values, origin=SE2(*pose))
    x_m, y_m = mask.grid.origin.apply(*place)
    cells = shapely.union_all(
        [square(row, column, mask.grid) for row, column in np.argwhere(values)]
    )
    point = shapely.Point(x_m, y_m)
    if cells.boundary.distance(point) > 1e-6:
        assert mask.has(x_m, y_m) is bool(cells.contains(point))
