"""Symmetries of maps: those that were built into a random map are found, wherever it lies."""

import math

import numpy as np
import pytest

from robotctl.estimation.mcl.map_symmetry import symmetries
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap


def scattered(seed: int, shape: tuple[int, int] = (160, 240)) -> np.ndarray:
    cells = np.zeros(shape, np.int8)
    rng = np.random.default_rng(seed)
    for _ in range(25):
        row, column = rng.integers((shape[0] - 12, shape[1] - 12))
        cells[row : row + rng.integers(2, 12), column : column + rng.integers(2, 12)] = 100
    return cells


def carries_onto_itself(motion: SE2, grid: GridMap) -> float:
    """Share of the walls that a motion puts within 0.3 m of a wall."""
    points = grid.centre_of(np.argwhere(grid.occupied()))
    moved = np.array([motion.apply(x, y) for x, y in points])
    off = np.hypot(*(moved[:, None] - points[None, ::3]).transpose(2, 0, 1)).min(axis=1)
    return float(np.mean(off < 0.3))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("origin", [SE2(), SE2(-7.0, 3.0, 0.0), SE2(20.0, 5.0, 0.6)])
def test_a_map_that_is_the_same_upside_down_is_found_to_be_so(seed, origin):
    half = scattered(seed)
    grid = GridMap(np.maximum(half, half[::-1, ::-1]), 0.05, origin)
    middle = origin @ SE2(6.0, 4.0)
    found = symmetries(grid)
    turned = [each for each in found if abs(each.theta_rad) > 3.0]
    assert turned
    x, y = turned[0].apply(middle.x_m, middle.y_m)
    assert math.hypot(x - middle.x_m, y - middle.y_m) < 0.4
    assert carries_onto_itself(turned[0], grid) > 0.95


@pytest.mark.parametrize("quarters", [1, 3])
def test_a_map_that_is_the_same_after_a_quarter_turn_is_found_to_be_so(quarters):
    cells = scattered(3, (200, 200))
    for _ in range(3):
        cells = np.maximum(cells, np.rot90(cells))
    grid = GridMap(np.ascontiguousarray(cells), 0.05, SE2(-3.0, 8.0))
    wanted = math.remainder(quarters * math.pi / 2.0, math.tau)
    found = [e for e in symmetries(grid) if abs(e.theta_rad - wanted) < 0.1]
    assert found
    assert carries_onto_itself(found[0], grid) > 0.95


def test_aisles_that_repeat_are_shifts():
    cells = np.zeros((200, 400), np.int8)
    for column in range(20, 380, 50):
        cells[20:180, column : column + 8] = 100
    grid = GridMap(cells, 0.05)
    shifts = [e for e in symmetries(grid) if e.theta_rad == 0.0]
    assert any(abs(abs(e.x_m) - 2.5) < 0.3 and abs(e.y_m) < 0.3 for e in shifts)


def test_a_map_without_walls_has_none():
    assert symmetries(GridMap(np.zeros((20, 20), np.int8), 0.1)) == []
