"""The beam model: its mixture against the book's formulas, and learned from what it draws."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robotctl.estimation.ranging.beam_model import BeamModel, BeamModelConfig
from robotctl.estimation.ranging.likelihood_config import BeamSkipping
from robotctl.estimation.ranging.range_casting import RangeCaster
from robotctl.estimation.ranging.range_mixture import BeamMixture, learned, log_density
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import FREE, OCCUPIED, GridMap
from robotctl.model.sensors.range_scan import RangeScan

MIXTURE = BeamMixture(0.6, 0.2, 0.05, 0.15, sigma_m=0.08, offset_m=0.03, short_per_m=0.7)
FAR_M = 10.0


def two_rooms(origin: SE2) -> GridMap:
    """Rooms of 3 m by 4 m and 4 m by 4 m with a door, and a pillar in the second."""
    cells = np.full((80, 140), FREE, np.int8)
    cells[[0, -1], :] = OCCUPIED
    cells[:, [0, -1]] = OCCUPIED
    cells[:50, 60:62] = OCCUPIED
    cells[20:26, 100:110] = OCCUPIED
    return GridMap(cells, 0.05, origin)


def book(mixture: BeamMixture, z_star: float, z: float) -> float:
    """Likelihood of one range: Probabilistic Robotics, equations 6.4 to 6.12, without an eta."""
    if z >= FAR_M:
        return mixture.none + (mixture.hit if z_star == math.inf else 0.0)
    off = (z - z_star - mixture.offset_m) / mixture.sigma_m
    p = mixture.hit * math.exp(-0.5 * off * off) / (mixture.sigma_m * math.sqrt(2 * math.pi))
    if z < z_star:
        rate = mixture.short_per_m
        eta = 1.0 / (1.0 - math.exp(-rate * min(z_star, FAR_M)))
        p += mixture.short * eta * rate * math.exp(-rate * z)
    return p + mixture.random / FAR_M


def test_the_density_is_that_of_the_book():
    rng = np.random.default_rng(1)
    expected = rng.uniform(0.0, 9.9, (50, 30))
    expected[:, :3] = np.inf
    expected[:, 4] = 0.0
    measured = rng.uniform(0.0, 9.9, 50)
    measured[:10] = expected[:10, 7] + 0.05
    measured[40:45] = np.inf
    measured[45:] = FAR_M
    wanted = [
        [math.log(book(MIXTURE, z_star, z)) for z_star in row]
        for row, z in zip(expected, measured, strict=True)
    ]
    assert np.allclose(log_density(MIXTURE, expected, measured, FAR_M), wanted, atol=2e-5)


@pytest.mark.parametrize("z_star", [1.0, 4.2, 9.0, math.inf])
def test_all_readings_together_have_probability_1(z_star):
    z = np.linspace(0.0, FAR_M, 100_001)[:-1]
    density = np.exp(log_density(MIXTURE, np.full((100_000, 1), z_star), z, FAR_M)[:, 0])
    none = np.exp(log_density(MIXTURE, np.full((1, 1), z_star), np.array([np.inf]), FAR_M)).item()
    assert density.mean() * FAR_M + none == pytest.approx(1.0, abs=1e-3)


def drawn(mixture: BeamMixture, z_star: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Draw a range for each expected one, part by part."""
    n = len(z_star)
    part = rng.choice(4, n, p=[mixture.hit, mixture.short, mixture.none, mixture.random])
    hit = z_star + mixture.offset_m + mixture.sigma_m * rng.standard_normal(n)
    cut = -np.expm1(-mixture.short_per_m * np.minimum(z_star, FAR_M))
    short = -np.log1p(-rng.random(n) * cut) / mixture.short_per_m
    z = np.choose(part, [hit, short, np.full(n, np.inf), FAR_M * rng.random(n)])
    return np.where(z < FAR_M, np.maximum(z, 0.0), np.inf)


def test_learning_finds_the_mixture_that_drew_the_ranges():
    rng = np.random.default_rng(2)
    z_star = rng.uniform(0.5, 8.0, 40_000)
    z_star[:2000] = np.inf
    z_star[2000:2010] = 0.0
    z = drawn(MIXTURE, z_star, rng)
    z[5000:5100] = np.nan
    found = learned(BeamMixture(), z_star, z, FAR_M, iterations=200)
    for key in ("hit", "short", "none", "random"):
        assert getattr(found, key) == pytest.approx(getattr(MIXTURE, key), abs=0.02)
    assert found.sigma_m == pytest.approx(MIXTURE.sigma_m, rel=0.05)
    assert found.offset_m == pytest.approx(MIXTURE.offset_m, abs=0.004)
    assert found.short_per_m == pytest.approx(MIXTURE.short_per_m, rel=0.15)


def test_no_step_of_learning_makes_the_ranges_less_likely():
    rng = np.random.default_rng(3)
    z_star = rng.uniform(0.5, 8.0, 5000)
    z = drawn(MIXTURE, z_star, rng)
    mixture = BeamMixture(sigma_m=0.5, short_per_m=3.0)
    before = -math.inf
    for _ in range(15):
        total = sum(math.log(book(mixture, a, b)) for a, b in zip(z_star, z, strict=True))
        assert total >= before - 1e-6
        before = total
        mixture = learned(mixture, z_star, z, FAR_M, iterations=1)


def test_no_part_is_learned_to_be_impossible():
    exact = np.linspace(1.0, 5.0, 100)
    found = learned(BeamMixture(), exact, exact, FAR_M)
    assert min(found.short, found.none, found.random) > 5e-4
    assert found.sigma_m >= 1e-3


def test_learning_from_nothing_is_refused():
    with pytest.raises(ValueError, match="no pair"):
        learned(BeamMixture(), np.array([1.0]), np.array([np.nan]), FAR_M)


def scan_from(grid: GridMap, pose: SE2, **sensor: float) -> RangeScan:
    """The scan without noise from a pose of base, by a caster of its own."""
    at = pose @ SE2(sensor.get("x_m", 0.0), sensor.get("y_m", 0.0))
    angles = np.linspace(-2.2, 2.2, 90)
    ranges = RangeCaster(grid).cast(np.array([[at.x_m, at.y_m, at.theta_rad]]), angles, FAR_M)
    return RangeScan(0, angles, ranges[:, 0], FAR_M, **sensor)


def test_the_true_pose_is_likelier_than_any_other_also_for_a_sensor_off_the_middle():
    grid = two_rooms(SE2(3.0, -1.0, 0.5))
    truth = grid.origin @ SE2(4.5, 2.9, -2.0)
    scan = scan_from(grid, truth, x_m=0.3, y_m=-0.1)
    rng = np.random.default_rng(4)
    poses = np.array([[truth.x_m, truth.y_m, truth.theta_rad]] * 1000)
    poses[1:] += rng.uniform(-1.0, 1.0, (999, 3)) * [2.0, 2.0, 3.0]
    values = BeamModel(grid).measurement(scan)(poses)
    assert np.argmax(values) == 0
    assert values[0] == pytest.approx(0.0, abs=2.0)
    far = np.hypot(*(poses[:, :2] - poses[0, :2]).T) > 0.5
    assert values[far].max() < values[0] - 3.0


def test_the_log_likelihood_is_the_tempered_sum_over_the_beams():
    grid = two_rooms(SE2())
    scan = scan_from(grid, SE2(1.5, 2.0, 0.3))
    ranges = scan.ranges_m.copy()
    ranges[5], ranges[17] = np.nan, np.inf
    scan = RangeScan(0, scan.angles_rad, ranges, FAR_M)
    poses = np.array([[1.5, 2.0, 0.3], [1.6, 2.0, 0.2], [5.0, 3.0, -1.0]])
    model = BeamModel(grid, BeamModelConfig(beams=1000, beam_correlation=0.1))
    expected = RangeCaster(grid).cast(poses, scan.angles_rad, FAR_M)
    for i, value in enumerate(model.log_likelihood(poses, scan)):
        total = sum(
            math.log(book(BeamMixture(), z_star, z))
            for z_star, z in zip(expected[:, i], ranges, strict=True)
            if not math.isnan(z)
        )
        assert value == pytest.approx(total / (1 + 88 * 0.1), rel=1e-4)


def test_a_scan_without_a_reading_says_nothing():
    scan = RangeScan(0, np.zeros(3), np.full(3, np.nan), FAR_M)
    values = BeamModel(two_rooms(SE2())).log_likelihood(np.zeros((4, 3)), scan)
    assert np.array_equal(values, np.zeros(4))


def test_skipping_takes_the_harm_out_of_a_crowd_but_not_out_of_a_wrong_pose():
    grid = two_rooms(SE2())
    scan = scan_from(grid, SE2(1.5, 2.0, 0.3))
    crowded = scan.ranges_m.copy()
    crowded[20:50] = 0.5
    crowded = RangeScan(0, scan.angles_rad, crowded, FAR_M)
    plain = BeamModel(grid)
    skipping = BeamModel(grid, BeamModelConfig(skipping=BeamSkipping(enabled=True)))
    rng = np.random.default_rng(5)
    near = np.array([1.5, 2.0, 0.3]) + 0.03 * rng.standard_normal((400, 3))
    assert np.all(skipping.log_likelihood(near, crowded) > plain.log_likelihood(near, crowded) + 3)
    spread = rng.uniform([0.5, 0.5, -3.0], [6.5, 3.5, 3.0], (400, 3))
    wrong = np.array([5.5, 1.0, -2.5]) + 0.03 * rng.standard_normal((400, 3))
    for poses in (spread, wrong):
        assert np.array_equal(
            skipping.log_likelihood(poses, scan), plain.log_likelihood(poses, scan)
        )


@pytest.mark.parametrize(
    ("key", "value"), [("hit", 0.9), ("sigma_m", 0.0), ("short_per_m", math.nan)]
)
def test_a_number_of_the_mixture_out_of_its_range_is_refused(key, value):
    with pytest.raises(ValueError, match=key):
        BeamMixture(**{key: value})


@pytest.mark.parametrize(("key", "value"), [("beams", 0), ("beam_correlation", 1.0)])
def test_a_number_of_the_model_out_of_its_range_is_refused(key, value):
    with pytest.raises(ValueError, match=key):
        BeamModelConfig(**{key: value})
