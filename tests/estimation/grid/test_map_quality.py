from __future__ import annotations

import math

import numpy as np
import pytest

from robotctl.estimation.grid.map_quality import map_quality, wall_cells
from robotctl.estimation.grid.occupancy_grid import OccupancyGrid
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import FREE, OCCUPIED, UNKNOWN, GridMap
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.wall_map import WallMap
from tests.estimation.grid.textbook_grid import crosses

ROOM = WallMap(
    np.array([[0.0, 0, 4, 0], [4, 0, 4, 3], [4, 3, 0, 3], [0, 3, 0, 0], [1, 1, 2, 1.5]], float)
)


def drawn(origin, resolution_m=0.1, rows=70, columns=80):
    """Return a map whose occupied cells are exactly those that a wall passes."""
    grid = GridMap(np.full((rows, columns), FREE, np.int8), resolution_m, origin)
    cells = grid.cells.copy()
    cells[tuple(wall_cells(grid, ROOM).T)] = OCCUPIED
    return GridMap(cells, resolution_m, origin)


@pytest.mark.parametrize("seed", range(3))
def test_wall_cells_are_those_whose_square_a_wall_meets(seed):
    rng = np.random.default_rng(seed)
    origin = SE2(-0.53, -0.41, rng.uniform(-0.1, 0.1))
    walls = WallMap(rng.uniform(0.0, 3.0, (3, 4)))
    grid = GridMap(np.zeros((40, 40), np.int8), 0.2, origin)
    expected = set()
    for ax, ay, bx, by in walls.segments:
        a, b = (
            [value / 0.2 for value in origin.inverse().apply(*point)]
            for point in ((ax, ay), (bx, by))
        )
        expected |= {
            (row, column)
            for row in range(-2, 40)
            for column in range(-2, 40)
            if crosses((row, column), a, b)
        }
    assert set(map(tuple, wall_cells(grid, walls).tolist())) == expected


def test_a_map_with_the_walls_exactly_is_perfect_also_when_it_is_turned():
    for origin in (SE2(-1.0, -1.0, 0.0), SE2(-1.0, -3.0, 0.4)):
        quality = map_quality(drawn(origin), ROOM)
        assert (quality.precision, quality.recall) == (1.0, 1.0)
        assert quality.occupied == quality.walls


@pytest.mark.parametrize(("shift", "good"), [(1, True), (2, False)])
def test_one_cell_off_is_tolerated_and_two_are_not(shift, good):
    grid = drawn(SE2(-1.03, -1.03, 0.0))
    cells = np.roll(grid.cells, shift, axis=0)
    quality = map_quality(GridMap(cells, grid.resolution_m, grid.origin), ROOM)
    # The two walls along the shift stay where they are, but for their ends.
    expected = 1.0 if good else pytest.approx(0.45, abs=0.15)
    assert quality.precision == expected
    assert quality.recall == expected


def test_missing_walls_lower_recall_and_false_cells_precision_alone():
    grid = drawn(SE2(-1.0, -1.0, 0.0))
    half = grid.cells.copy()
    half[:, 30:] = UNKNOWN
    quality = map_quality(GridMap(half, 0.1, grid.origin), ROOM)
    assert quality.precision == 1.0
    assert 0.4 < quality.recall < 0.8
    false = grid.cells.copy()
    false[30, 14:44:3] = OCCUPIED
    quality = map_quality(GridMap(false, 0.1, grid.origin), ROOM)
    assert quality.recall == 1.0
    assert quality.precision < 1.0


def test_walls_outside_of_the_map_count_and_an_empty_map_scores_nothing():
    small = GridMap(np.full((3, 3), UNKNOWN, np.int8), 0.1, SE2(50.0, 50.0, 0.3))
    quality = map_quality(small, ROOM)
    assert (quality.precision, quality.recall, quality.occupied) == (0.0, 0.0, 0)
    assert quality.walls > 100


def room_scan(pose, n=360, noise_m=0.0, rng=None):
    """Return an exact scan of the room's walls by intersecting each beam with each wall."""
    angles = np.linspace(-math.pi, math.pi, n, endpoint=False)
    ranges = np.full(n, math.inf)
    for i, angle in enumerate(angles):
        dx, dy = math.cos(angle + pose.theta_rad), math.sin(angle + pose.theta_rad)
        for ax, ay, bx, by in ROOM.segments:
            ux, uy = bx - ax, by - ay
            turn = dx * uy - dy * ux
            if turn == 0.0:
                continue
            along = ((ax - pose.x_m) * uy - (ay - pose.y_m) * ux) / turn
            share = ((ax - pose.x_m) * dy - (ay - pose.y_m) * dx) / turn
            if along > 0.0 and 0.0 <= share <= 1.0:
                ranges[i] = min(ranges[i], along)
    if rng is not None:
        ranges += rng.normal(0.0, noise_m, n)
    return RangeScan(0, angles, ranges, 12.0)


def test_a_room_seen_from_a_few_places_is_mapped_within_a_cell():
    rng = np.random.default_rng(1)
    grid = OccupancyGrid()
    for x, y in ((0.5, 0.5), (3.5, 0.5), (3.3, 2.5), (0.5, 2.5), (2.5, 0.8), (2.0, 2.2)):
        pose = SE2(x, y, rng.uniform(-3.0, 3.0))
        grid.update_scan(pose, room_scan(pose, noise_m=0.01, rng=rng))
    quality = map_quality(grid.to_map(), ROOM)
    assert quality.precision > 0.99
    assert quality.recall > 0.97
