from __future__ import annotations

import math

import numpy as np
import pytest

from robotctl.estimation.grid.occupancy_grid import OccupancyGrid, OccupancyGridConfig
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import FREE, OCCUPIED, UNKNOWN
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.sensors.sonar import SonarMount
from tests.estimation.grid.textbook_grid import classify, cone

SIDE_M = 0.25
CONFIG = OccupancyGridConfig(
    resolution_m=SIDE_M,
    range_limit_m=3.5,
    no_echo_m=2.5,
    fan_deg=20.0,
    sonar_width_deg=40.0,
    sonar_range_m=3.5,
    sonar_no_echo_m=2.0,
)
HIT, MISS = CONFIG.steps(CONFIG.hit), CONFIG.steps(CONFIG.miss)


def random_scan(rng, n, begin_rad, sweep_rad, max_range_m=4.0):
    """Return a scan of a jagged room: steps, missing echoes, invalid readings."""
    ranges = np.repeat(rng.uniform(0.1, 4.0, n), rng.integers(1, 6, n))[:n]
    ranges = np.clip(ranges + rng.normal(0.0, 0.1, n), 0.05, 4.5)
    ranges[rng.random(n) < 0.1] = math.inf
    ranges[rng.random(n) < 0.1] = math.nan
    angles = begin_rad + np.arange(n) * sweep_rad / n + rng.uniform(0.0, 0.01, n)
    return RangeScan(0, angles, ranges, max_range_m, x_m=0.1, y_m=-0.05)


def stored(grid, cells=40):
    """Return the log odds [steps] of a square of cells with the world's origin in its middle."""
    result = np.zeros((2 * cells, 2 * cells), int)
    known = np.rint(grid.log_odds() / grid.config.step).astype(int)
    origin = grid.to_map().origin
    row = round(origin.y_m / grid.config.resolution_m) + cells
    column = round(origin.x_m / grid.config.resolution_m) + cells
    result[row : row + known.shape[0], column : column + known.shape[1]] = known
    return result


def textbook(pose, scan, cells=40):
    sensor = pose @ SE2(scan.x_m, scan.y_m, 0.0)
    return classify(
        (2 * cells, 2 * cells),
        (sensor.x_m / SIDE_M + cells, sensor.y_m / SIDE_M + cells),
        scan.angles_rad + pose.theta_rad,
        scan.ranges_m / SIDE_M,
        scan.max_range_m / SIDE_M,
        CONFIG.range_limit_m / SIDE_M,
        CONFIG.no_echo_m / SIDE_M,
        math.radians(CONFIG.fan_deg),
    )


@pytest.mark.parametrize("seed", range(6))
def test_a_scan_says_of_each_cell_what_the_textbook_loop_says(seed):
    rng = np.random.default_rng(seed)
    sweep = (math.pi, 1.5 * math.pi, 2.0 * math.pi)[seed % 3]
    n = (18, 40, 60)[seed // 2]
    scan = random_scan(rng, n, rng.uniform(-3.0, 0.0), sweep)
    pose = SE2(*rng.uniform(-1.0, 1.0, 2), rng.uniform(-3.0, 3.0))
    grid = OccupancyGrid(CONFIG)
    grid.update_scan(pose, scan)
    said = textbook(pose, scan)
    assert {-1, 0, 1} <= set(np.unique(said))
    np.testing.assert_array_equal(stored(grid), np.select([said < 0, said > 0], [-MISS, HIT], 0))


def test_beams_in_any_order_and_either_sense_give_the_same_grid():
    rng = np.random.default_rng(7)
    scan = random_scan(rng, 40, -2.0, math.pi)
    order = np.arange(40)[::-1]
    turned = RangeScan(0, scan.angles_rad[order], scan.ranges_m[order], 4.0, scan.x_m, scan.y_m)
    one, other = OccupancyGrid(CONFIG), OccupancyGrid(CONFIG)
    one.update_scan(SE2(), scan)
    other.update_scan(SE2(), turned)
    np.testing.assert_array_equal(stored(one), stored(other))


def test_a_second_turn_over_the_same_directions_changes_nothing_more():
    rng = np.random.default_rng(8)
    scan = random_scan(rng, 40, -math.pi, 2.0 * math.pi)
    twice = RangeScan(
        0,
        np.concatenate([scan.angles_rad, scan.angles_rad + 2.0 * math.pi]),
        np.concatenate([scan.ranges_m, scan.ranges_m]),
        4.0,
        scan.x_m,
        scan.y_m,
    )
    one, other = OccupancyGrid(CONFIG), OccupancyGrid(CONFIG)
    one.update_scan(SE2(), scan)
    other.update_scan(SE2(), twice)
    np.testing.assert_array_equal(stored(one), stored(other))


def test_a_batch_is_the_same_as_one_scan_after_the_other():
    rng = np.random.default_rng(9)
    scans = [random_scan(rng, int(rng.integers(0, 50)), -2.0, 4.0) for _ in range(150)]
    poses = rng.uniform(-2.0, 2.0, (150, 3))
    one, other = OccupancyGrid(CONFIG), OccupancyGrid(CONFIG)
    one.update_scans(poses, scans)
    for pose, scan in zip(poses, scans, strict=True):
        other.update_scan(SE2(*pose), scan)
    np.testing.assert_array_equal(stored(one), stored(other))
    assert np.abs(stored(one)).max() > HIT


def test_beams_along_the_middles_of_rows_and_the_edges_of_cells_stay_in_the_grid():
    n = 720
    angles = np.arange(n) * math.tau / n
    ranges = np.where(np.arange(n) % 3 == 0, 3.0, 1.0)
    scan = RangeScan(0, angles, ranges, 4.0)
    for heading in (0.0, math.pi / 2, math.pi, -math.pi / 2):
        for x, y in ((0.125, 0.125), (0.0, 0.0), (0.25, 1e-17), (3.875, 3.875)):
            grid = OccupancyGrid(CONFIG)
            grid.update_scan(SE2(x, y, heading), scan)
            rows, columns = np.nonzero(stored(grid))
            assert np.abs(columns + 0.5 - 40 - x / SIDE_M).max() < 3.0 / SIDE_M + 1.0
            assert np.abs(rows + 0.5 - 40 - y / SIDE_M).max() < 3.0 / SIDE_M + 1.0
            # Half of the circle within the shorter beams, at least, is free.
            assert np.count_nonzero(stored(grid) < 0) * SIDE_M**2 > 0.5 * math.pi


def beam(range_m, angle_rad=0.0, max_range_m=4.0):
    return RangeScan(0, np.array([angle_rad]), np.array([range_m]), max_range_m)


def test_log_odds_add_up_and_are_clamped_and_learn_a_changed_room():
    grid = OccupancyGrid(CONFIG)
    pose = SE2(0.125, 0.125, 0.0)
    for looks in range(1, 40):
        grid.update_scan(pose, beam(2.0))
        expected = [max(-127, -looks * MISS), min(127, looks * HIT)]
        assert [stored(grid)[40, 42], stored(grid)[40, 48]] == expected
    for _ in range(50):
        grid.update_scan(pose, beam(3.0))
    assert stored(grid)[40, 48] == -127


def test_a_beam_without_echo_marks_free_space_only_and_nan_nothing():
    grid = OccupancyGrid(CONFIG)
    for range_m, free_to_m in ((math.inf, 2.5), (4.0, 3.5), (3.75, 3.5), (9.0, 3.5)):
        grid.reset()
        grid.update_scan(SE2(0.01, 0.125, 0.0), beam(range_m))
        line = stored(grid)[40, 40:]
        assert not np.any(stored(grid) > 0)
        assert np.count_nonzero(line) == math.floor((free_to_m + 0.01) / SIDE_M) + 1
    grid.reset()
    grid.update_scan(SE2(), beam(math.nan))
    assert not np.any(stored(grid))


def test_an_empty_scan_and_no_scan_at_all_leave_the_grid_unknown():
    grid = OccupancyGrid(CONFIG)
    grid.update_scans(np.empty((0, 3)), [])
    grid.update_scan(SE2(), RangeScan(0, np.empty(0), np.empty(0), 4.0))
    assert grid.to_map().cells.tolist() == [[UNKNOWN]]
    assert grid.figures().seen_m2 == 0.0


def test_the_grid_grows_in_every_direction_and_cells_stay_in_place():
    grid = OccupancyGrid(CONFIG)
    echoes = []
    for k, (x, y) in enumerate([(0, 0), (60, 3), (-45, -80), (7, 90), (-130, 20), (200, -200)]):
        pose = SE2(x + 0.125, y + 0.125, 0.5 * math.pi * k)
        grid.update_scan(pose, beam(2.0))
        echoes.append(pose.apply(2.0, 0.0))
    result = grid.to_map(occupied_above=0.65, free_below=0.49)
    hits = result.cell_of(np.array(echoes))
    assert np.all(result.cells[hits[:, 0], hits[:, 1]] == OCCUPIED)
    assert np.count_nonzero(result.cells == OCCUPIED) == 6
    assert np.count_nonzero(result.cells == FREE) == 6 * 8


def test_a_pose_far_off_is_refused_and_the_grid_stays():
    grid = OccupancyGrid(CONFIG)
    grid.update_scan(SE2(), beam(2.0))
    before = stored(grid)
    with pytest.raises(ValueError, match=r"cells of 0.25 m would be needed, at most"):
        grid.update_scan(SE2(1e6, 1e6, 0.0), beam(2.0))
    for pose in (SE2(math.nan), SE2(0.0, math.inf), SE2(0.0, 0.0, math.inf), SE2(1e300)):
        with pytest.raises(ValueError, match=r"finite|less than 1e"):
            grid.update_scan(pose, beam(2.0))
        with pytest.raises(ValueError, match=r"finite|less than 1e"):
            grid.update_sonar(pose, SonarMount("front", 0.0, 0.0, 0.0), 1.0)
    with pytest.raises(ValueError, match=r"\(2, 3\)"):
        grid.update_scans(np.zeros((1, 3)), [beam(2.0), beam(2.0)])
    np.testing.assert_array_equal(stored(grid), before)


@pytest.mark.parametrize("seed", range(5))
def test_a_sonar_says_of_each_cell_what_the_textbook_loop_says(seed):
    rng = np.random.default_rng(seed)
    pose = SE2(*rng.uniform(-1.0, 1.0, 2), rng.uniform(-3.0, 3.0))
    mount = SonarMount("left", 0.1, 0.2, 77.0)
    range_m, said_m = ((0.02, 0.02), (1.3, 1.3), (3.1, 3.1), (4.0, 3.5), (math.inf, 2.0))[seed]
    grid = OccupancyGrid(CONFIG)
    grid.update_sonar(pose, mount, range_m)
    sensor = pose @ SE2(0.1, 0.2, math.radians(77.0))
    said = cone(
        (80, 80),
        (sensor.x_m / SIDE_M + 40, sensor.y_m / SIDE_M + 40),
        sensor.theta_rad,
        math.radians(20.0),
        said_m / SIDE_M,
        math.sqrt(0.5),
        range_m < CONFIG.sonar_range_m,
    )
    miss, hit = CONFIG.steps(CONFIG.sonar_miss), CONFIG.steps(CONFIG.sonar_hit)
    np.testing.assert_array_equal(stored(grid), np.select([said < 0, said > 0], [-miss, hit], 0))


def test_a_sonar_without_echo_clears_nan_does_nothing_and_a_negative_range_is_refused():
    grid = OccupancyGrid(CONFIG)
    mount = SonarMount("front", 0.0, 0.0, 0.0)
    grid.update_sonar(SE2(), mount, math.nan)
    assert not np.any(stored(grid))
    grid.update_sonar(SE2(), mount, CONFIG.sonar_range_m)
    assert np.any(stored(grid) < 0)
    assert not np.any(stored(grid) > 0)
    with pytest.raises(ValueError, match="found -1"):
        grid.update_sonar(SE2(), mount, -1.0)


def test_figures_are_those_of_the_probabilities():
    rng = np.random.default_rng(3)
    grid = OccupancyGrid(CONFIG)
    for _ in range(5):
        grid.update_scan(SE2(*rng.uniform(-1.0, 1.0, 3)), random_scan(rng, 60, -2.0, 4.0))
    odds = grid.log_odds()
    p = np.exp(odds) / (1.0 + np.exp(odds))
    entropy = -(p * np.log2(p) + (1.0 - p) * np.log2(1.0 - p))
    figures, seen = grid.figures(), odds != 0.0
    assert figures.entropy_bits == pytest.approx(entropy.sum())
    assert figures.mean_entropy_bits == pytest.approx(entropy[seen].mean())
    assert figures.seen_m2 == pytest.approx(np.count_nonzero(seen) * SIDE_M**2)
    assert figures.coverage == pytest.approx(seen.mean())
    cells = grid.to_map(0.7, 0.3).cells
    np.testing.assert_array_equal(cells == OCCUPIED, p > 0.7)
    np.testing.assert_array_equal(cells == FREE, p < 0.3)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("resolution_m", 0.0),
        ("hit", 5.0),
        ("miss", 0.01),
        ("fan_deg", 90.0),
        ("no_echo_m", math.inf),
    ],
)
def test_a_wrong_setting_is_refused_with_its_name_and_value(key, value):
    with pytest.raises(ValueError, match=f"{key} must lie in .*, found {value}"):
        OccupancyGridConfig(**{key: value})


def test_thresholds_of_a_map_must_be_in_order():
    with pytest.raises(ValueError, match=r"found 0.7 and 0.6"):
        OccupancyGrid(CONFIG).to_map(occupied_above=0.6, free_below=0.7)
