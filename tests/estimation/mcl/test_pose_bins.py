"""Bins of poses: KLD sampling against Fox's formula, clusters against a textbook flood fill."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from robotctl.estimation.mcl.belief import clusters
from robotctl.estimation.mcl.pose_bins import BinSize, connected_bins, kld_bound, kld_size

SIZE = BinSize(0.25, 36)
ERROR, QUANTILE = 0.05, float(stats.norm.ppf(0.99))


@pytest.mark.parametrize("bins", [2, 3, 17, 400])
def test_the_bound_is_foxs_formula(bins):
    k = bins
    literal = (
        (k - 1)
        / (2 * ERROR)
        * (1 - 2 / (9 * (k - 1)) + math.sqrt(2 / (9 * (k - 1))) * QUANTILE) ** 3
    )
    assert kld_bound(bins, ERROR, QUANTILE) == math.ceil(literal)


@pytest.mark.parametrize("bins", [5, 50, 500])
def test_the_bound_is_near_the_chi_square_quantile_that_it_stands_for(bins):
    exact = stats.chi2.ppf(0.99, bins - 1) / (2 * ERROR)
    assert kld_bound(bins, ERROR, QUANTILE) == pytest.approx(exact, rel=0.01)


def test_one_bin_needs_one_particle():
    assert kld_bound(1, ERROR, QUANTILE) == 1


def size_of(poses: np.ndarray, seed: int = 1, least: int = 20, most: int = 100_000) -> int:
    weights = np.full(len(poses), 1 / len(poses))
    rng = np.random.default_rng(seed)
    return kld_size(poses, weights, SIZE, ERROR, QUANTILE, least, most, rng)


def test_particles_that_fill_k_bins_evenly_get_the_number_that_k_bins_need():
    centres = (np.arange(40) + 0.5) * 0.25
    poses = np.stack([np.repeat(centres, 50), np.zeros(2000) + 0.1, np.full(2000, 0.1)], axis=1)
    assert size_of(poses) == kld_bound(40, ERROR, QUANTILE)


def test_a_compact_belief_needs_few_particles_and_a_wide_one_as_many_as_allowed():
    rng = np.random.default_rng(0)
    narrow = rng.normal(size=(5000, 3)) * 0.01 + 0.1
    wide = rng.uniform(-20.0, 20.0, (5000, 3))
    assert size_of(narrow, least=70) == 70
    assert size_of(wide, most=3000) == 3000


def test_the_number_hardly_depends_on_the_draw():
    rng = np.random.default_rng(0)
    poses = rng.normal(size=(5000, 3)) * (0.5, 0.5, 0.2)
    numbers = [size_of(poses, seed) for seed in range(30)]
    assert np.std(numbers) < 0.05 * np.mean(numbers)


def bin_of(pose: np.ndarray, size: BinSize) -> tuple[int, int, int]:
    share = (pose[2] % math.tau) / math.tau
    heading = min(int(share * size.headings), size.headings - 1)
    return math.floor(pose[0] / size.side_m), math.floor(pose[1] / size.side_m), heading


def textbook_clusters(poses: np.ndarray, size: BinSize) -> list[int]:
    """Flood fill over a set of bins."""
    bins = [bin_of(pose, size) for pose in poses]
    number: dict[tuple[int, int, int], int] = {}
    count = 0
    for start in bins:
        if start in number:
            continue
        number[start] = count
        todo = [start]
        while todo:
            x, y, t = todo.pop()
            for other in set(bins):
                near = abs(other[0] - x) <= 1 and abs(other[1] - y) <= 1
                steps = (other[2] - t) % size.headings
                if near and steps in {0, 1, size.headings - 1} and other not in number:
                    number[other] = count
                    todo.append(other)
        count += 1
    return [number[b] for b in bins]


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.sampled_from([1, 2, 3, 7]))
def test_clusters_are_those_of_a_textbook_flood_fill(seed, n, headings):
    size = BinSize(0.5, headings)
    rng = np.random.default_rng(seed)
    poses = rng.uniform(-2.0, 2.0, (n, 3)) * (1.0, 1.0, 2.0)
    assert connected_bins(poses, size).tolist() == textbook_clusters(poses, size)


def test_a_cluster_goes_on_across_the_cut_of_the_circle():
    poses = np.array([[0.1, 0.1, math.pi - 0.01], [0.1, 0.1, -math.pi + 0.01], [0.1, 0.1, 0.0]])
    assert connected_bins(poses, SIZE).tolist() == [0, 0, 1]


def test_far_away_poses_have_bins_of_their_own():
    poses = np.array([[0.1, 0.1, 0.0], [5e5, 0.1, 0.0], [0.1, -5e5, 0.0]])
    assert connected_bins(poses, SIZE).tolist() == [0, 1, 2]


def test_the_heaviest_cluster_comes_first_with_its_own_mean():
    rng = np.random.default_rng(5)
    left = rng.normal(size=(300, 3)) * 0.05 + (-3.0, 1.0, 3.1)
    right = rng.normal(size=(700, 3)) * 0.05 + (3.0, 2.0, 0.0)
    poses = np.concatenate([left, right])
    found = clusters(poses, np.full(1000, 1e-3), SIZE, 8)
    assert [round(cluster.weight, 6) for cluster in found] == [0.7, 0.3]
    assert (found[0].mean.x_m, found[0].mean.y_m) == pytest.approx((3.0, 2.0), abs=0.01)
    assert math.cos(found[1].mean.theta_rad - 3.1) == pytest.approx(1.0, abs=1e-3)
    assert found[0].sigma_m == pytest.approx(0.05, rel=0.15)
    assert found[0].sigma_rad == pytest.approx(0.05, rel=0.15)


@pytest.mark.parametrize(
    ("side", "headings"), [(0.0, 36), (math.inf, 36), (0.2, 0), (0.2, 1 << 14)]
)
def test_a_bin_out_of_range_is_refused(side, headings):
    with pytest.raises(ValueError, match="must be"):
        BinSize(side, headings)
