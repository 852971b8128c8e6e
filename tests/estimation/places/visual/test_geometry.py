"""Matches of two views fit together, and those of different places do not."""

import math

import numpy as np
import pytest

from robotctl.estimation.places.visual.geometry import common_geometry, log10_chance

ASPECT = 0.75
WIDTH, HEIGHT = 0.8, 0.6
"""Of an image whose diagonal is 1."""


def spread(rng, n):
    return rng.random((n, 2)) * (WIDTH, HEIGHT)


def seen(points, shift, turn=0.0):
    """Project points, (n, 3), by a camera moved by `shift` and turned about y."""
    c, s = math.cos(turn), math.sin(turn)
    at = (points - shift) @ np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]]).T
    return 0.6 * at[:, :2] / at[:, 2:] + (WIDTH / 2, HEIGHT / 2)


def scene(rng, n, depths):
    image = spread(rng, n) - (WIDTH / 2, HEIGHT / 2)
    z = rng.uniform(*depths, n)
    return np.column_stack([image / 0.6 * z[:, None], z])


def test_a_plane_is_found_among_wrong_matches():
    rng = np.random.default_rng(0)
    points = scene(rng, 40, (3.0, 3.0))
    a = np.vstack([seen(points, (0.0, 0.0, 0.0)), spread(rng, 40)])
    b = np.vstack([seen(points, (0.4, 0.0, 0.5), 0.1), spread(rng, 40)])
    fit = common_geometry(a, b, ASPECT, np.random.default_rng(1))
    assert fit.model == "plane"
    assert set(range(40)) <= set(fit.inliers)
    assert len(fit.inliers) <= 42
    assert fit.log10_chance < -40.0


def test_a_scene_with_depth_needs_a_fundamental_matrix():
    rng = np.random.default_rng(2)
    points = np.vstack([scene(rng, 15, (6.0, 6.0)), scene(rng, 30, (1.5, 4.0))])
    a = np.vstack([seen(points, (0.0, 0.0, 0.0)), spread(rng, 10)])
    b = np.vstack([seen(points, (0.5, 0.1, 0.3), 0.05), spread(rng, 10)])
    fit = common_geometry(a, b, ASPECT, np.random.default_rng(3))
    assert fit.model == "scene"
    right = set(range(45)) & set(fit.inliers)
    assert len(right) >= 38
    assert len(fit.inliers) <= len(right) + 3


@pytest.mark.parametrize("n", [0, 5, 12, 40, 150])
def test_random_matches_have_nothing_in_common(n):
    for seed in range(10):
        rng = np.random.default_rng([n, seed])
        fit = common_geometry(spread(rng, n), spread(rng, n), ASPECT, rng)
        assert fit.log10_chance > -3.0


def test_a_mirrored_image_does_not_fit():
    rng = np.random.default_rng(4)
    a = spread(rng, 40)
    fit = common_geometry(a, (WIDTH, 0.0) + a * (-1.0, 1.0), ASPECT, rng)
    assert fit.model == "none"


def test_points_on_one_spot_do_not_fit():
    rng = np.random.default_rng(5)
    b = np.full((40, 2), 0.3) + 1e-4 * rng.random((40, 2))
    assert common_geometry(spread(rng, 40), b, ASPECT, rng).log10_chance > -3.0


def test_chance_is_that_of_all_choices_of_matches():
    expected = math.log10((10 - 4) * math.comb(10, 7) * math.comb(7, 4) * 0.01**3)
    assert log10_chance(10, 7, 4, 0.01) == pytest.approx(expected)
    assert log10_chance(10, 4, 4, 0.01) == 0.0
