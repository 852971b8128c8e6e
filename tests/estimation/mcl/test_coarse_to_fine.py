"""A search of a large map: what it finds, and that its parts stay small."""

import math

import numpy as np
import pytest

from robotctl.estimation.mcl.coarse_to_fine import best_anywhere
from robotctl.estimation.mcl.config import MclConfig
from robotctl.estimation.mcl.free_space import free_poses
from robotctl.estimation.mcl.localiser import MonteCarloLocaliser
from robotctl.estimation.mcl.sliced import SLICE, Work, at_once
from robotctl.estimation.ranging.likelihood_config import LikelihoodFieldConfig
from robotctl.estimation.ranging.likelihood_field import LikelihoodField
from robotctl.estimation.ranging.range_casting import RangeCaster
from robotctl.model.grid_map import GridMap
from robotctl.model.sensors.range_scan import RangeScan

SIDE_M = 60.0
BEAMS = np.linspace(-math.pi, math.pi, 180, endpoint=False)


@pytest.fixture(scope="module")
def yard() -> GridMap:
    """Open ground of 3600 m2 with walls and pillars of all sizes."""
    rng = np.random.default_rng(8)
    cells = np.zeros((1200, 1200), np.int8)
    for row, column in rng.integers(0, 1150, (120, 2)):
        high, wide = rng.integers(4, 90, 2) if rng.random() < 0.3 else rng.integers(4, 25, 2)
        cells[row : row + high, column : column + wide] = 100
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    return GridMap(cells, 0.05)


def scan_at(grid: GridMap, pose: np.ndarray) -> RangeScan:
    """Return a noisy scan from a pose, by casting its rays."""
    ranges = RangeCaster(grid).cast(pose[None], BEAMS, 30.0)[:, 0]
    ranges = np.maximum(ranges + np.random.default_rng(1).normal(0.0, 0.02, 180), 0.05)
    return RangeScan(0, BEAMS, ranges, 30.0)


def away(pose: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return whether poses are farther than 0.15 m or 3 degrees."""
    turned = np.abs(np.angle(np.exp(1j * (others[:, 2] - pose[2]))))
    return (np.hypot(*(others[:, :2] - pose[:2]).T) > 0.15) | (turned > math.radians(3.0))


@pytest.mark.parametrize("seed", range(5))
def test_fifty_poses_a_square_metre_lead_to_where_a_scan_was_taken(yard, seed):
    free = free_poses(yard)
    pose = free(np.random.default_rng(100 + seed), 1)[0]
    measurement = LikelihoodField(yard).measurement(scan_at(yard, pose))
    rng = np.random.default_rng(seed)
    poses, logs = at_once(best_anywhere(free, rng, measurement, 180_000, 1000))
    assert len(poses) == len(logs) == 1000
    np.testing.assert_array_equal(logs, measurement(poses))
    assert not away(pose, poses[[np.argmax(logs)]])[0]
    # As many random poses alone hold none that fits nearly as well.
    assert measurement(free(rng, 180_000)).max() < logs.max() - 3.0


def test_of_another_sensor_the_best_of_all_random_poses_are_kept(yard):
    def log_likelihood(poses: np.ndarray) -> np.ndarray:
        return -np.hypot(poses[:, 0] - 20.0, poses[:, 1] - 30.0)

    free = free_poses(yard)
    poses, logs = at_once(best_anywhere(free, np.random.default_rng(3), log_likelihood, 23_000, 70))
    rng = np.random.default_rng(3)
    drawn = np.concatenate([free(rng, n) for n in (5000, 5000, 5000, 5000, 3000)])
    best = np.sort(log_likelihood(drawn))[-70:]
    np.testing.assert_array_equal(np.sort(logs), best)
    np.testing.assert_array_equal(log_likelihood(poses), logs)


def test_the_coarse_likelihood_of_a_place_is_no_less_than_that_of_poses_in_it(yard):
    """With the same beams: by the triangle inequality, 0.15 nat for the sides of cells."""
    field = LikelihoodField(yard, LikelihoodFieldConfig(beams=20, beam_correlation=0.0))
    rng = np.random.default_rng(5)
    for pose in free_poses(yard)(rng, 20):
        measurement = field.measurement(scan_at(yard, pose))
        for side_m, turn_rad in ((1.0, 0.1), (0.5, 0.05), (0.25, 0.02)):
            # Half as far off as to the corners, so within what a coarse beam reaches.
            off = rng.uniform(-0.25, 0.25, (50, 3)) * (side_m, side_m, turn_rad)
            coarse = measurement.coarse(side_m, turn_rad)(pose + off)
            assert np.all(coarse >= measurement(pose[None]) - 0.15 * 20)
            assert np.all(coarse >= measurement(pose + off))


def test_no_part_of_a_search_is_large_and_all_parts_do_the_work_at_once(yard):
    free = free_poses(yard)
    pose = free(np.random.default_rng(101), 1)[0]
    measurement = LikelihoodField(yard).measurement(scan_at(yard, pose))
    config = MclConfig(max_particles=20_000, search_poses=180_000)
    sliced, whole = (MonteCarloLocaliser(config, free, np.random.default_rng(4)) for _ in range(2))
    whole.measure(measurement)
    work, rounds = Work(), 1
    work.begin(sliced.measuring(measurement), 10_000)
    while work.is_under_way:
        left = work.go_on(10_000)
        assert left > -SLICE
        rounds += 1
    assert rounds > 5
    np.testing.assert_array_equal(sliced.poses, whole.poses)
    assert len(whole.poses) <= 40_000
    assert not away(pose, whole.poses[[np.argmax(whole.weights)]])[0]
