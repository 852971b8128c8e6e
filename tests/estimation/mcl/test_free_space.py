"""Random poses of free space."""

import math

import numpy as np
import pytest
from scipy import stats

from robotctl.estimation.mcl.free_space import free_poses
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import FREE, OCCUPIED, UNKNOWN, GridMap

PICTURE = """
........#...
........#...
...??...#...
........#...
"""
CELLS = {".": FREE, "#": OCCUPIED, "?": UNKNOWN}


def picture(origin: SE2) -> GridMap:
    rows = [[CELLS[sign] for sign in row] for row in PICTURE.split()]
    return GridMap(np.array(rows, np.int8), 0.5, origin)


@pytest.mark.parametrize("origin", [SE2(), SE2(2.0, -3.0, 0.7)])
def test_poses_lie_in_the_largest_free_region_and_fill_it_evenly(origin):
    grid = picture(origin)
    poses = free_poses(grid)(np.random.default_rng(1), 30_000)
    cells = grid.cell_of(poses[:, :2])
    counts = np.zeros(grid.cells.shape)
    np.add.at(counts, (cells[:, 0], cells[:, 1]), 1)
    region = grid.free()
    region[:, 9:] = False
    assert counts[~region].sum() == 0
    assert stats.chisquare(counts[region]).pvalue > 1e-3


def test_headings_are_uniform():
    poses = free_poses(picture(SE2()))(np.random.default_rng(2), 5000)
    uniform = stats.uniform(-math.pi, math.tau)
    assert stats.kstest(poses[:, 2], uniform.cdf).pvalue > 1e-3


def test_a_point_chooses_the_region():
    grid = picture(SE2())
    poses = free_poses(grid, inside=(5.0, 1.0))(np.random.default_rng(1), 500)
    assert np.all(poses[:, 0] >= 4.5)


@pytest.mark.parametrize("inside", [(4.25, 0.25), (1.6, 1.2), (-1.0, 0.0), (100.0, 0.0)])
def test_a_point_that_is_not_free_is_refused(inside):
    with pytest.raises(ValueError, match="inside must be a free point"):
        free_poses(picture(SE2()), inside)


def test_a_map_without_free_cells_is_refused():
    grid = GridMap(np.full((3, 3), UNKNOWN, np.int8), 0.1)
    with pytest.raises(ValueError, match="no free cell"):
        free_poses(grid)
