"""The likelihood field against a textbook loop, and what it promises of odd scans and maps."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robotctl.estimation.grid.occupancy_grid import OccupancyGrid
from robotctl.estimation.ranging.likelihood_config import BeamSkipping, LikelihoodFieldConfig
from robotctl.estimation.ranging.likelihood_field import LikelihoodField
from robotctl.estimation.ranging.range_casting import RangeCaster
from robotctl.logs.formats.carmen_log import read_carmen
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import FREE, OCCUPIED, UNKNOWN, GridMap
from robotctl.model.sensors.range_scan import RangeScan

HERE = SE2()


def room(origin: SE2 = HERE, resolution_m: float = 0.1) -> GridMap:
    """A room of 6 m by 4 m with a pillar, an unknown corner, and no symmetry."""
    cells = np.full((40, 60), FREE, np.int8)
    cells[[0, -1], :] = OCCUPIED
    cells[:, [0, -1]] = OCCUPIED
    cells[25:30, 40:46] = OCCUPIED
    cells[1:6, 1:4] = UNKNOWN
    return GridMap(cells, resolution_m, origin)


def random_scan(rng: np.random.Generator, beams: int = 40, **sensor: float) -> RangeScan:
    return RangeScan(
        0,
        np.sort(rng.uniform(-math.pi, math.pi, beams)),
        rng.uniform(0.1, 7.0, beams),
        8.0,
        **sensor,
    )


def random_poses(rng: np.random.Generator, n: int, world_map: SE2) -> np.ndarray:
    """Poses in the map, a few outside of it."""
    poses = np.empty((n, 3))
    for i in range(n):
        pose = world_map @ SE2(rng.uniform(-1.0, 7.0), rng.uniform(-1.0, 5.0), rng.uniform(-4, 4))
        poses[i] = pose.x_m, pose.y_m, pose.theta_rad
    return poses


def textbook(grid: GridMap, config: LikelihoodFieldConfig, poses: np.ndarray, scan: RangeScan):
    """Probabilistic Robotics, table 6.3, by loops; the nearest obstacle by trying all."""
    obstacles = np.argwhere(grid.cells >= 50)
    floor = math.log(config.robust_k / (1 + config.robust_k))
    result = np.zeros(len(poses))
    for i, (x, y, theta) in enumerate(poses):
        for beam, (angle, distance) in enumerate(zip(scan.angles_rad, scan.ranges_m, strict=True)):
            if not distance < scan.max_range_m:
                continue
            own = 0.0 if scan.sigmas_m is None else scan.sigmas_m[beam]
            sigma_m = min(math.hypot(config.sigma_m, own), 16.0 * config.sigma_m)
            px = scan.x_m + distance * math.cos(angle)
            py = scan.y_m + distance * math.sin(angle)
            end = SE2(x, y, theta).apply(px, py)
            row, column = grid.cell_of(np.array([end]))[0]
            if not (0 <= row < grid.cells.shape[0] and 0 <= column < grid.cells.shape[1]):
                result[i] += floor
                continue
            steps = np.hypot(obstacles[:, 0] - row, obstacles[:, 1] - column).min()
            hit = math.exp(-0.5 * (steps * grid.resolution_m / sigma_m) ** 2)
            result[i] += math.log((hit + config.robust_k) / (1 + config.robust_k))
    return result


def test_a_beam_that_says_how_sure_it_is_is_weighed_so():
    rng = np.random.default_rng(7)
    grid = room()
    config = LikelihoodFieldConfig(beams=100, beam_correlation=0.0, sigma_m=0.15)
    field = LikelihoodField(grid, config)
    poses = random_poses(rng, 50, SE2())
    for own in (0.0, 0.05, 0.15 * math.sqrt(3.0), 0.15 * math.sqrt(15.0), 90.0):
        scan = replace(random_scan(rng), sigmas_m=np.full(40, own))
        expected = textbook(grid, config, poses, scan)
        # Standard deviations are rounded to steps of sqrt(2); these are such steps but the second.
        tolerance = 0.15 if own == 0.05 else 0.005
        found = field.log_likelihood(poses, scan)
        close = np.isclose(found, expected, rtol=tolerance)
        assert close.mean() > 0.95  # not where float32 puts an end point into the next cell


def test_beams_of_one_scan_may_be_differently_sure():
    rng = np.random.default_rng(8)
    field = LikelihoodField(room(), LikelihoodFieldConfig(beam_correlation=0.0))
    poses = random_poses(rng, 50, SE2())
    scan = random_scan(rng)
    sigmas = np.where(np.arange(40) % 2, 0.5, 0.0)
    mixed = field.log_likelihood(poses, replace(scan, sigmas_m=sigmas))
    parts = [
        field.log_likelihood(
            poses,
            replace(
                scan,
                ranges_m=np.where(sigmas == sigma, scan.ranges_m, math.nan),
                sigmas_m=np.where(sigmas == sigma, sigmas, math.nan),
            ),
        )
        for sigma in (0.0, 0.5)
    ]
    assert mixed == pytest.approx(parts[0] + parts[1], rel=1e-5)


@pytest.mark.parametrize("origin", [SE2(), SE2(-3.0, 2.0, 0.7), SE2(40.0, -60.0, -2.5)])
def test_weighing_equals_the_textbook_loop_wherever_the_map_lies_and_however_it_is_turned(origin):
    rng = np.random.default_rng(1)
    grid = room(origin)
    config = LikelihoodFieldConfig(beams=100, beam_correlation=0.0, sigma_m=0.15)
    scan = random_scan(rng, x_m=0.2, y_m=-0.1)
    poses = random_poses(rng, 300, origin)
    found = LikelihoodField(grid, config).log_likelihood(poses, scan)
    wanted = textbook(grid, config, poses, scan)
    # An end point on the edge of two cells may fall to either: one beam of forty differs.
    assert np.mean(np.abs(found - wanted) < 1e-3) > 0.97
    assert np.allclose(found, wanted, atol=2.0)


def test_beams_are_multiplied_so_that_a_scan_of_two_halves_adds_their_logs():
    rng = np.random.default_rng(2)
    scan = random_scan(rng, 30)
    field = LikelihoodField(room(), LikelihoodFieldConfig(beam_correlation=0.0))
    poses = random_poses(rng, 200, SE2())
    parts = [
        RangeScan(0, scan.angles_rad[half], scan.ranges_m[half], scan.max_range_m)
        for half in (slice(None, 13), slice(13, None))
    ]
    whole = field.log_likelihood(poses, scan)
    assert np.allclose(whole, sum(field.log_likelihood(poses, part) for part in parts), atol=1e-4)


def test_the_power_makes_correlated_beams_worth_fewer_independent_ones():
    """Kish's design effect, checked by drawing beams that share a part of their error."""
    rng = np.random.default_rng(3)
    correlation = 0.05
    shared = math.sqrt(correlation) * rng.standard_normal((50_000, 1))
    own = math.sqrt(1 - correlation) * rng.standard_normal((50_000, 60))
    worth = 60 / ((shared + own).sum(axis=1).var() / 60)
    full = LikelihoodField(room(), LikelihoodFieldConfig(beam_correlation=0.0))
    tempered = LikelihoodField(room(), LikelihoodFieldConfig(beam_correlation=correlation))
    scan, poses = random_scan(rng, 60), random_poses(rng, 50, SE2())
    whole = full.log_likelihood(poses, scan)
    assert np.allclose(tempered.log_likelihood(poses, scan), worth / 60 * whole, rtol=0.03)
    one = random_scan(rng, 1)
    assert np.allclose(tempered.log_likelihood(poses, one), full.log_likelihood(poses, one))


def test_beams_without_a_hit_are_left_out():
    rng = np.random.default_rng(4)
    scan, poses = random_scan(rng, 40), random_poses(rng, 50, SE2())
    odd = np.array([np.inf, np.nan, scan.max_range_m, 1e300])
    longer = RangeScan(
        0,
        np.concatenate([scan.angles_rad, np.zeros(4)]),
        np.concatenate([scan.ranges_m, odd]),
        scan.max_range_m,
    )
    field = LikelihoodField(room())
    assert np.array_equal(field.log_likelihood(poses, longer), field.log_likelihood(poses, scan))
    nothing = RangeScan(0, np.zeros(4), odd, scan.max_range_m)
    assert np.array_equal(field.log_likelihood(poses, nothing), np.zeros(50))


def test_the_chosen_beams_are_spread_over_the_valid_ones():
    grid = room()
    field = LikelihoodField(grid, LikelihoodFieldConfig(beams=4, beam_correlation=0.0))
    angles = np.linspace(-math.pi, math.pi, 80, endpoint=False)
    pose = np.array([[3.0, 2.0, 0.0]])
    floor = math.log(0.05 / 1.05)
    for wrong in range(0, 80, 20):
        # Of each quarter of the beams one is taken, so one quarter that ends nowhere costs one.
        ranges = np.array([_ray(grid, 3.0, 2.0, angle) for angle in angles])
        ranges[wrong : wrong + 20] = 0.5
        value = field.log_likelihood(pose, RangeScan(0, angles, ranges, 8.0))[0]
        assert value == pytest.approx(floor, abs=0.2)


def _ray(grid: GridMap, x: float, y: float, angle: float) -> float:
    """Range to the first obstacle, by small steps."""
    steps = np.arange(0.0, 8.0, 0.01)
    points = np.stack([x + steps * math.cos(angle), y + steps * math.sin(angle)], axis=1)
    rows_columns = np.clip(grid.cell_of(points), 0, np.array(grid.cells.shape) - 1)
    return float(steps[np.argmax(grid.cells[*rows_columns.T] == OCCUPIED)])


def test_the_true_pose_is_likelier_than_any_other():
    grid = room(SE2(1.0, -2.0, 0.4))
    truth = grid.origin @ SE2(2.0, 1.5, 0.3)
    angles = np.linspace(-2.0, 2.0, 60)
    ranges = np.array(
        [_ray(grid, truth.x_m, truth.y_m, truth.theta_rad + angle) for angle in angles]
    )
    scan = RangeScan(0, angles, ranges, 8.0)
    rng = np.random.default_rng(5)
    others = random_poses(rng, 2000, grid.origin)
    poses = np.concatenate([[[truth.x_m, truth.y_m, truth.theta_rad]], others])
    values = LikelihoodField(grid).measurement(scan)(poses)
    assert np.argmax(values) == 0
    assert values[0] > -1.0
    far = np.hypot(poses[:, 0] - truth.x_m, poses[:, 1] - truth.y_m) > 0.5
    assert values[far].max() < values[0] - 3.0


def crowded_scan(grid: GridMap) -> RangeScan:
    """The scan from (2, 2) with people in front of a quarter of the beams."""
    angles = np.linspace(-math.pi, math.pi, 60, endpoint=False)
    ranges = np.array([_ray(grid, 2.0, 2.0, angle) for angle in angles])
    ranges[20:35] = 0.6
    return RangeScan(0, angles, ranges, 8.0)


def test_beam_skipping_leaves_out_what_no_close_pose_agrees_with():
    grid = room()
    config = LikelihoodFieldConfig(skipping=BeamSkipping(enabled=True))
    scan = crowded_scan(grid)
    rng = np.random.default_rng(6)
    near = np.array([2.0, 2.0, 0.0]) + rng.normal(size=(500, 3)) * [0.05, 0.05, 0.02]
    clean = RangeScan(
        0, np.delete(scan.angles_rad, slice(20, 35)), np.delete(scan.ranges_m, slice(20, 35)), 8.0
    )
    skipped = LikelihoodField(grid, config).log_likelihood(near, scan)
    untempered = LikelihoodField(grid, LikelihoodFieldConfig(beam_correlation=0.0))
    unharmed = untempered.log_likelihood(near, clean) / (1 + 59 * config.beam_correlation)
    assert np.allclose(skipped, unharmed, atol=1e-4)
    assert np.all(LikelihoodField(grid).log_likelihood(near, scan) < skipped - 5.0)


def test_beam_skipping_is_off_while_the_poses_are_spread_or_most_beams_speak_against_them():
    grid = room()
    scan = crowded_scan(grid)
    with_skipping = LikelihoodField(
        grid, LikelihoodFieldConfig(skipping=BeamSkipping(enabled=True))
    )
    without = LikelihoodField(grid)
    rng = np.random.default_rng(7)
    spread = random_poses(rng, 500, SE2())
    turned = np.tile([2.0, 2.0, 0.0], (500, 1))
    turned[:, 2] = rng.uniform(-3.0, 3.0, 500)
    elsewhere = np.array([4.9, 0.7, 2.0]) + rng.normal(size=(500, 3)) * 0.02
    for poses in (spread, turned, elsewhere):
        assert np.array_equal(
            with_skipping.log_likelihood(poses, scan), without.log_likelihood(poses, scan)
        )


def test_the_beams_skipped_for_the_belief_are_skipped_for_all_other_places():
    grid = room()
    skipping = LikelihoodField(grid, LikelihoodFieldConfig(skipping=BeamSkipping(enabled=True)))
    scan = crowded_scan(grid)
    rng = np.random.default_rng(8)
    near = np.array([2.0, 2.0, 0.0]) + rng.normal(size=(500, 3)) * [0.05, 0.05, 0.02]
    elsewhere = random_poses(rng, 500, SE2())
    measurement = skipping.measurement(scan)
    measurement(near)
    assert np.all(measurement(elsewhere) >= LikelihoodField(grid).log_likelihood(elsewhere, scan))
    assert np.any(measurement(elsewhere) > skipping.log_likelihood(elsewhere, scan) + 1.0)


def shortened(scan: RangeScan, share: float) -> RangeScan:
    """Somebody stands before that share of the beams, half as far away as the wall."""
    ranges = scan.ranges_m.copy()
    ranges[: round(share * len(ranges))] *= 0.5
    return replace(scan, ranges_m=ranges)


def test_forgiven_is_a_beam_that_ends_too_early_and_not_one_that_goes_through_a_wall():
    """Half the beams too short cost half a bit each; as many too long cost what they do anyway."""
    grid = room()
    field = LikelihoodField(grid, LikelihoodFieldConfig(beam_correlation=0.0))
    angles = np.linspace(-1.2, 1.2, 40)
    here = np.array([[1.5, 2.0, 0.3]])
    ranges = RangeCaster(grid).cast(here, angles, 8.0)[:, 0] + 0.05
    right = RangeScan(0, angles, ranges, 8.0)
    crowd, behind = shortened(right, 0.5), shortened(right, 0.5)
    behind = replace(behind, ranges_m=np.where(behind.ranges_m < ranges, ranges + 1.0, ranges))
    perfect = field.log_likelihood(here, right)[0]
    of_crowd, of_walls = field.measurement(crowd), field.measurement(behind)
    assert of_crowd(here)[0] < perfect - 30.0
    assert perfect - 20 * math.log(2.0) - 1.0 < of_crowd.forgiven(here)[0] <= perfect
    assert of_walls.forgiven(here)[0] == pytest.approx(of_walls(here)[0], abs=1e-3)
    assert of_walls(here)[0] < perfect - 30.0
    assert field.measurement(right).forgiven(here)[0] == pytest.approx(perfect, abs=1e-3)


def test_off_the_map_nothing_is_forgiven():
    grid = room()
    field = LikelihoodField(grid)
    angles = np.linspace(-3.0, 3.0, 60)
    measurement = field.measurement(RangeScan(0, angles, np.full(60, 1.0), 40.0))
    for pose in ([-20.0, 2.0, 0.0], [30.0, 30.0, 1.0], [3.0, -9.0, 2.0]):
        poses = np.array([pose])
        assert measurement.forgiven(poses)[0] == pytest.approx(measurement(poses)[0])


def test_forgiveness_never_lowers_a_likelihood_and_needs_no_echo():
    rng = np.random.default_rng(11)
    field = LikelihoodField(room(SE2(3.0, -2.0, 0.7)))
    scan = random_scan(rng, x_m=0.2, y_m=-0.1)
    poses = random_poses(rng, 200, SE2(3.0, -2.0, 0.7))
    measurement = field.measurement(scan)
    assert np.all(measurement.forgiven(poses) >= measurement(poses) - 1e-3)
    nothing = replace(scan, ranges_m=np.full(len(scan.ranges_m), np.inf))
    assert np.array_equal(field.measurement(nothing).forgiven(poses), np.zeros(200))


@pytest.mark.recordings("carmen/intel-odometry.log.gz")
def test_on_a_real_log_the_reference_is_likelier_than_places_a_little_off(recordings: Path):
    """The map of the even scans, weighed by the odd ones: 0.3 m or 10 degrees off is worse."""
    log = read_carmen(recordings / "carmen" / "intel-odometry.log.gz").scans[:240]
    poses = np.array([(e.reference.x_m, e.reference.y_m, e.reference.theta_rad) for e in log])
    grid = OccupancyGrid()
    grid.update_scans(poses[::2], [entry.scan for entry in log[::2]])
    field = LikelihoodField(grid.to_map())
    turn = math.radians(10)
    off = [
        (0, 0, 0),
        (0.3, 0, 0),
        (-0.3, 0, 0),
        (0, 0.3, 0),
        (0, -0.3, 0),
        (0, 0, turn),
        (0, 0, -turn),
    ]
    best = [
        np.argmax(field.log_likelihood(pose + np.array(off), entry.scan)) == 0
        for pose, entry in zip(poses[1::2], log[1::2], strict=True)
    ]
    assert np.mean(best) > 0.9


def test_a_map_without_obstacles_is_refused():
    with pytest.raises(ValueError, match="no obstacle"):
        LikelihoodField(GridMap(np.zeros((5, 5), np.int8), 0.1))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("beams", 0),
        ("sigma_m", 0.0),
        ("robust_k", -1.0),
        ("beam_correlation", 1.0),
    ],
)
def test_a_number_out_of_its_range_is_refused_by_name(key, value):
    with pytest.raises(ValueError, match=key):
        LikelihoodFieldConfig(**{key: value})


@pytest.mark.parametrize(("key", "value"), [("sigmas", 5.0), ("below", 1.0), ("at_most", 0.0)])
def test_a_number_of_skipping_out_of_its_range_is_refused_by_name(key, value):
    with pytest.raises(ValueError, match=key):
        BeamSkipping(**{key: value})
