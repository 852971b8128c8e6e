"""Walls and corners of cells, against a look at every cell."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.world.cells import ROOM_M, Cells
from tests.firmware_sim.world.cell_rooms import cells, in_cells


def occupied(each: Cells, row: int, column: int) -> bool:
    rows, columns = each.occupied.shape
    return 0 <= row < rows and 0 <= column < columns and bool(each.occupied[row, column])


def unit_sides(each: Cells) -> set[tuple[int, int, int, int]]:
    """Sides between an occupied cell and another, each a cell long, in cells."""
    rows, columns = each.occupied.shape
    found = set()
    for row, column in itertools.product(range(rows + 1), range(columns + 1)):
        if occupied(each, row, column) != occupied(each, row - 1, column):
            found.add((column, row, column + 1, row))
        if occupied(each, row, column) != occupied(each, row, column - 1):
            found.add((column, row, column, row + 1))
    return found


@given(cells())
def test_the_walls_are_the_sides_between_occupied_cells_and_others(each: Cells) -> None:
    split = []
    for wall in each.walls():
        ends = [in_cells(each, *end) for end in (wall[:2], wall[2:])]
        (ax, ay), (bx, by) = (tuple(round(value) for value in end) for end in ends)
        assert np.allclose(ends, [(ax, ay), (bx, by)], atol=1e-9)
        assert (ax == bx) != (ay == by)
        way = (int(np.sign(bx - ax)), int(np.sign(by - ay)))
        for step in range(abs(bx - ax) + abs(by - ay)):
            at = (ax + step * way[0], ay + step * way[1])
            split.append((*at, at[0] + way[0], at[1] + way[1]))
    assert len(split) == len(set(split))
    assert set(split) == unit_sides(each)


def test_a_long_wall_is_one_however_many_cells_it_has() -> None:
    blocks = np.zeros((40, 1000), bool)
    blocks[20, 10:990] = True
    walls = Cells(blocks, ~blocks, 0.05, (0.0, 0.0, 0.0)).walls()
    assert sorted(np.hypot(*(walls[:, 2:] - walls[:, :2]).T).round(9).tolist()) == [
        0.05, 0.05, 49.0, 49.0
    ]  # fmt: skip


@given(cells())
def test_a_corner_is_where_a_cell_has_walls_on_two_sides(each: Cells) -> None:
    expected = set()
    rows, columns = each.occupied.shape
    for row, column in itertools.product(range(-1, rows + 1), range(-1, columns + 1)):
        if occupied(each, row, column):
            continue
        for right, up in itertools.product((-1, 1), (-1, 1)):
            if occupied(each, row, column + right) and occupied(each, row + up, column):
                # The walls lie beyond the corner, so the arms lead back along the cell's sides.
                expected.add((column + (right > 0), row + (up > 0), -right, -up))
    theta = each.origin[2]
    c, s = math.cos(theta), math.sin(theta)
    found = set()
    for x, y, ux, uy, vx, vy in each.corners():
        column, row = (round(value) for value in in_cells(each, x, y))
        assert np.allclose(in_cells(each, x, y), (column, row), atol=1e-9)
        along, up = c * ux + s * uy, -s * vx + c * vy
        assert np.allclose([-s * ux + c * uy, c * vx + s * vy], 0.0, atol=1e-9)
        found.add((column, row, round(along), round(up)))
    assert found == expected
    assert len(each.corners()) == len(expected)


@given(cells(), st.floats(-12, 12), st.floats(-12, 12))
def test_a_point_is_occupied_or_free_as_its_cell_is(each: Cells, x: float, y: float) -> None:
    column, row = (math.floor(value) for value in in_cells(each, x, y))
    rows, columns = each.occupied.shape
    inside = 0 <= row < rows and 0 <= column < columns
    point = np.array([[x, y]])
    assert each.is_occupied(point)[0] == (inside and each.occupied[row, column])
    assert each.is_free(point)[0] == (inside and each.free[row, column])


@pytest.mark.parametrize("theta", [0.0, 0.7, -2.5])
def test_the_clear_way_leads_from_the_roomiest_place_along_the_hall(theta: float) -> None:
    free = np.zeros((60, 200), bool)
    free[10:50, 10:50] = True  # a hall of 4 m by 4 m
    free[25:45, 50:150] = True  # from which a corridor of 2 m leads 10 m
    hall = Cells(~free, free, 0.1, (3.0, -2.0, theta))
    x, y, heading, length_m = hall.clear_way()
    column, row = in_cells(hall, x, y)
    assert (column, row) == (pytest.approx(30.0, abs=1.0), pytest.approx(30.0, abs=1.0))
    assert math.remainder(heading - theta, 2 * math.pi) == pytest.approx(0.0, abs=math.radians(10))
    assert 7.0 < length_m <= 8.0
    # All of it keeps its room: no wall's cell has a corner or a middle nearer than that.
    blocks = np.argwhere(hall.occupied)
    for share in np.linspace(0.0, 1.0, 50):
        at = in_cells(hall, x + share * length_m * math.cos(heading),
                      y + share * length_m * math.sin(heading))  # fmt: skip
        gaps = np.maximum(np.abs(blocks[:, ::-1] + 0.5 - at) - 0.5, 0.0)
        assert 0.1 * np.hypot(*gaps.T).min() > ROOM_M - 0.06


def test_where_all_is_narrow_there_is_no_way() -> None:
    free = np.zeros((9, 9), bool)
    free[4, 1:8] = True
    assert Cells(~free, free, 0.1, (0.0, 0.0, 0.0)).clear_way()[3] == 0.0
