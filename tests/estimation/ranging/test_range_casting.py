"""Ray casting against exact geometry: every occupied cell tried as a box."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from robotctl.estimation.ranging.range_casting import RangeCaster
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import FREE, OCCUPIED, UNKNOWN, GridMap


def scattered_map(
    rng: np.random.Generator, rows: int, columns: int, share: float, origin: SE2
) -> GridMap:
    cells = np.where(rng.random((rows, columns)) < share, OCCUPIED, FREE).astype(np.int8)
    return GridMap(cells, 0.25, origin)


def nearest_box(grid: GridMap, pose: np.ndarray, angle: float) -> float:
    """Range by the slab test on every occupied cell (Kay and Kajiya 1986)."""
    here = grid.origin.inverse() @ SE2(pose[0], pose[1], pose[2] + angle)
    rows, columns = np.nonzero(grid.occupied())
    low = np.stack([columns, rows], axis=1) * grid.resolution_m
    start = np.array([here.x_m, here.y_m])
    way = np.array([math.cos(here.theta_rad), math.sin(here.theta_rad)])
    with np.errstate(divide="ignore"):
        first, second = (low - start) / way, (low + grid.resolution_m - start) / way
    enters = np.minimum(first, second).max(axis=1)
    leaves = np.maximum(first, second).min(axis=1)
    hit = (enters <= leaves) & (leaves >= 0.0)
    return float(np.maximum(enters[hit], 0.0).min(initial=np.inf))


@pytest.mark.parametrize("is_small", [False, True])
@pytest.mark.parametrize("share", [0.002, 0.05, 0.4])
@pytest.mark.parametrize("origin", [SE2(), SE2(-7.0, 3.0, 1.1), SE2(100.0, 20.0, -2.8)])
def test_ranges_equal_those_to_the_nearest_box_from_inside_and_outside_of_the_map(
    share, origin, is_small
):
    rng = np.random.default_rng(11)
    grid = scattered_map(rng, 30, 300, share, origin)
    poses = np.empty((40, 3))
    for i in range(40):
        pose = origin @ SE2(rng.uniform(-5.0, 80.0), rng.uniform(-5.0, 12.0), rng.uniform(-9, 9))
        poses[i] = pose.x_m, pose.y_m, pose.theta_rad
    angles = rng.uniform(-math.pi, math.pi, 25)
    found = RangeCaster(grid, is_small=is_small).cast(poses, angles, 1000.0)
    wanted = np.array([[nearest_box(grid, pose, angle) for pose in poses] for angle in angles])
    assert found.shape == (25, 40)
    assert np.isfinite(wanted).sum() > 20
    assert np.array_equal(np.isfinite(found), np.isfinite(wanted))
    hit = np.isfinite(wanted)
    assert np.allclose(found[hit], wanted[hit], rtol=0.0, atol=1e-9)


def test_rays_along_rows_and_columns_find_the_wall_on_either_side():
    cells = np.full((300, 400), FREE, np.int8)
    cells[[0, -1], :] = OCCUPIED
    cells[:, [0, -1]] = OCCUPIED
    grid = GridMap(cells, 0.05)
    poses = np.array([[10.03, 7.51, 0.0]])
    angles = np.array([0.0, math.pi / 2, math.pi, -math.pi / 2])
    found = RangeCaster(grid).cast(poses, angles, 100.0)[:, 0]
    assert np.allclose(found, [19.95 - 10.03, 14.95 - 7.51, 10.03 - 0.05, 7.51 - 0.05])


def test_more_poses_than_a_block_holds_give_what_each_gives_alone():
    rng = np.random.default_rng(12)
    caster = RangeCaster(scattered_map(rng, 80, 80, 0.03, SE2()))
    poses = rng.uniform([0, 0, -3], [20, 20, 3], (700, 3))
    angles = np.linspace(-1.0, 1.0, 7)
    together = caster.cast(poses, angles, 50.0)
    some = rng.integers(0, 700, 30)
    alone = np.concatenate([caster.cast(poses[i : i + 1], angles, 50.0) for i in some], axis=1)
    assert np.array_equal(together[:, some], alone)


def test_beyond_the_greatest_range_nothing_is_seen():
    rng = np.random.default_rng(13)
    caster = RangeCaster(scattered_map(rng, 80, 80, 0.01, SE2()))
    poses = rng.uniform([0, 0, -3], [20, 20, 3], (200, 3))
    angles = np.linspace(-1.0, 1.0, 7)
    whole = caster.cast(poses, angles, 100.0)
    short = caster.cast(poses, angles, 3.0)
    assert np.array_equal(short, np.where(whole < 3.0, whole, np.inf))
    assert np.isinf(short).sum() > np.isinf(whole).sum()


def test_a_ray_that_starts_in_an_occupied_cell_has_range_0():
    cells = np.full((5, 5), OCCUPIED, np.int8)
    found = RangeCaster(GridMap(cells, 0.1)).cast(np.array([[0.25, 0.25, 1.0]]), np.zeros(1), 9.0)
    assert found.item() == 0.0


def test_rays_pass_through_unknown_cells():
    cells = np.full((10, 40), FREE, np.int8)
    cells[:, 20:] = UNKNOWN
    cells[:, 30] = OCCUPIED
    pose = np.array([[0.55, 0.55, 0.0]])
    found = RangeCaster(GridMap(cells, 0.1)).cast(pose, np.zeros(1), 9.0)
    assert found.item() == pytest.approx(3.0 - 0.55)


@pytest.mark.recordings("maps")
@pytest.mark.parametrize(("name", "resolution_m"), [("tb3_sandbox", 0.05), ("warehouse", 0.03)])
def test_on_real_maps_a_ray_is_free_up_to_its_range_and_ends_in_an_obstacle(
    recordings: Path, name: str, resolution_m: float
):
    image = cv2.imread(str(recordings / "maps" / f"{name}.pgm"), cv2.IMREAD_GRAYSCALE)
    cells = np.where(image[::-1] < 90, OCCUPIED, FREE).astype(np.int8)
    grid = GridMap(cells, resolution_m, SE2(-10.0, -10.0, 0.3))
    rng = np.random.default_rng(14)
    rows, columns = np.nonzero(image[::-1] > 250)
    chosen = rng.integers(0, len(rows), 60)
    centres = grid.centre_of(np.stack([rows[chosen], columns[chosen]], axis=1))
    poses = np.column_stack([centres, rng.uniform(-3.0, 3.0, 60)])
    angles = np.linspace(-math.pi, math.pi, 30, endpoint=False)
    found = RangeCaster(grid).cast(poses, angles, 100.0)
    heading = poses[:, 2] + angles[:, np.newaxis]
    way = np.stack([np.cos(heading), np.sin(heading)], axis=2)
    hit = np.isfinite(found)
    assert hit.sum() > 500
    ends = (poses[:, :2] + (np.where(hit, found, 0.0) + 1e-9)[..., np.newaxis] * way)[hit]
    assert occupied_at(grid, ends).all()
    for share in np.linspace(0.0, 1.0, 700, endpoint=False):
        on_way = poses[:, :2] + (share * np.where(hit, found, 30.0))[..., np.newaxis] * way
        assert not occupied_at(grid, on_way.reshape(-1, 2)).any()


def occupied_at(grid: GridMap, points: np.ndarray) -> np.ndarray:
    row, column = grid.cell_of(points).T
    inside = (row >= 0) & (row < grid.cells.shape[0])
    inside &= (column >= 0) & (column < grid.cells.shape[1])
    result = np.zeros(len(points), bool)
    result[inside] = grid.occupied()[row[inside], column[inside]]
    return result
