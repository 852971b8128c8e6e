"""A grid whose window goes elsewhere holds the same cells as one in which all fits."""

import numpy as np
import pytest

from robotctl.estimation.grid import occupancy_grid
from robotctl.estimation.grid.cell_tiles import SIDE, CellTiles
from robotctl.estimation.grid.occupancy_grid import OccupancyGrid, OccupancyGridConfig
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import FREE, OCCUPIED, UNKNOWN
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.sensors.sonar import SonarMount

CONFIG = OccupancyGridConfig(resolution_m=0.1, range_limit_m=6.0)


def drive(grid, seed=1):
    """A drive along a large loop and back over its beginning, in scans, batches and sonars."""
    rng = np.random.default_rng(seed)
    angles = np.linspace(-2.0, 2.0, 60)
    way = np.concatenate([np.linspace(0.0, 1.0, 80), np.linspace(0.0, 0.2, 20)]) * 2.0 * np.pi
    poses = np.stack([60.0 * np.cos(way), 40.0 * np.sin(way) - 7.0, way], axis=1)
    scans = [RangeScan(0, angles, rng.uniform(1.0, 8.0, 60), 9.0) for _ in poses]
    grid.update_scans(poses[:50], scans[:50])
    for pose, scan in zip(poses[50:], scans[50:], strict=True):
        grid.update_scan(SE2(*pose), scan)
        grid.update_sonar(SE2(*pose), SonarMount("s", 0.1, 0.0, 0.3), 1.5)
    return grid


@pytest.mark.parametrize("cells", [256 * 256, 512 * 512])
def test_the_map_does_not_depend_on_what_fits_into_the_window(monkeypatch, cells):
    whole = drive(OccupancyGrid(CONFIG))
    assert len(whole._tiles) == 0
    monkeypatch.setattr(occupancy_grid, "WINDOW_CELLS", cells)
    monkeypatch.setattr(occupancy_grid, "_NEW_WINDOW", 128)
    tiled = drive(OccupancyGrid(CONFIG))
    assert len(tiled._tiles) > 0
    for strays in (None, 0.001):
        a, b = (grid.map_rows(strays=strays) for grid in (whole, tiled))
        assert (a.shape, a.origin) == (b.shape, b.origin)
        np.testing.assert_array_equal(a.whole().cells, b.whole().cells)
        np.testing.assert_array_equal(b.rows(10, 50), b.whole().cells[10:50])
    np.testing.assert_array_equal(whole.log_odds(), tiled.log_odds())
    assert whole.figures() == tiled.figures()
    tiled.reset()
    assert tiled.to_map().cells.tolist() == [[UNKNOWN]]


def test_tiles_hold_what_was_put_last():
    tiles, rng = CellTiles(), np.random.default_rng(2)
    corner = np.array([-SIDE, 2 * SIDE])
    cells = rng.integers(-5, 6, (2 * SIDE, 3 * SIDE)).astype(np.int8)
    tiles.put(cells, corner)
    cells[:SIDE, SIDE : 2 * SIDE] = 0
    tiles.put(cells, corner)
    assert len(tiles) == 5
    larger = np.zeros((4 * SIDE, 5 * SIDE), np.int8)
    tiles.fill(larger, corner - SIDE)
    np.testing.assert_array_equal(larger[SIDE : 3 * SIDE, SIDE : 4 * SIDE], cells)
    assert not larger[:SIDE].any()


def test_a_map_is_cropped_to_what_is_known_but_for_strays_and_gets_a_margin():
    grid = OccupancyGrid(OccupancyGridConfig(resolution_m=0.05))
    room = RangeScan(0, np.linspace(-np.pi, np.pi, 720), np.full(720, 3.0), 20.0)
    for _ in range(5):
        grid.update_scan(SE2(10.0, 20.0, 0.0), room)
        grid.update_scan(
            SE2(10.0, 20.0, 0.0), RangeScan(0, np.array([0.0]), np.array([15.0]), 20.0)
        )
    whole, cropped = grid.map_rows(), grid.map_rows(strays=0.025)
    assert whole.shape[1] * 0.05 == pytest.approx(18.0, abs=0.3)
    assert whole.shape[0] * 0.05 == pytest.approx(6.0, abs=0.3)
    assert cropped.shape[0] * 0.05 == pytest.approx(6.7, abs=0.5)
    assert cropped.shape[1] * 0.05 == pytest.approx(6.7, abs=0.5)
    assert (cropped.origin.x_m, cropped.origin.y_m) == pytest.approx((6.5, 16.5), abs=0.4)
    cells = cropped.whole()
    for x, y, value in ((10.0, 20.0, FREE), (7.0, 20.0, OCCUPIED), (10.0, 23.0, OCCUPIED)):
        row, column = cells.cell_of(np.array([[x, y]]))[0]
        assert value in cells.cells[row - 1 : row + 2, column - 1 : column + 2]
    assert grid.map_rows(strays=0.0).shape[1] >= whole.shape[1]
