"""What colours say of the floor: against textbook loops, and by laws of light."""

from __future__ import annotations

import numpy as np
import pytest

from robotctl.estimation.camera import colour

LOG_PRIOR = colour.log_obstacle_prior()
GREY_BROWN = np.array([90.0, 110.0, 130.0])
NONE = np.zeros_like(LOG_PRIOR)


def bins_of(pixels: np.ndarray) -> np.ndarray:
    """Bins of single colours, (n, 3) BGR, one coarse cell of one row each."""
    strip = np.repeat(np.rint(pixels).astype(np.uint8)[:, None], 2, axis=1)
    edges, halves = np.arange(len(pixels) + 1), np.zeros(len(pixels), np.intp)
    return colour.colour_bins(strip, edges, halves)[1][:, 0]


def density(pixels: np.ndarray) -> np.ndarray:
    return colour.smoothed(colour.count(bins_of(pixels)))


def noisy(mean: np.ndarray, n: int = 2000, sigma: float = 4.0) -> np.ndarray:
    return np.clip(np.random.default_rng(3).normal(mean, sigma, (n, 3)), 0, 255)


def evidence(floor: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Evidence of one row of cells of given bins."""
    logs = colour.log_densities(floor, NONE, LOG_PRIOR)
    return colour.evidence(logs, seen[None].astype(np.int32))[0][0]


def test_means_are_those_of_a_textbook_loop() -> None:
    rng = np.random.default_rng(2)
    strip = rng.integers(0, 256, (17, 2 * 9, 3)).astype(np.uint8)
    edges, halves = np.array([0, 2, 7, 17]), np.array([0, 1, 3])
    means, _ = colour.colour_bins(strip, edges, halves)
    for i in range(3):
        for c in range(9):
            left, right = max(c - halves[i], 0), min(c + halves[i] + 1, 9)
            block = strip[edges[i] : edges[i + 1], 2 * left : 2 * right]
            assert means[i, c] == pytest.approx(block.reshape(-1, 3).mean(axis=0), rel=1e-5)


def test_another_light_moves_the_brightness_and_leaves_the_ratios() -> None:
    bins = bins_of(np.array([GREY_BROWN * gain for gain in (0.6, 0.8, 1.0, 1.4, 1.9)]))
    ratios, light = bins // colour.L_BINS, bins % colour.L_BINS
    red, blue = ratios // colour.C_BINS, ratios % colour.C_BINS
    assert np.ptp(red) <= 1
    assert np.ptp(blue) <= 1
    assert np.all(np.diff(light) > 0)


def test_densities_keep_their_sum_and_overlap_by_what_is_common() -> None:
    one, other = density(noisy(GREY_BROWN)), density(noisy(GREY_BROWN[::-1]))
    assert one.sum() == pytest.approx(1.0, abs=1e-4)
    assert colour.overlap(one, one) == pytest.approx(1.0, abs=1e-4)
    assert colour.overlap(one, other) == pytest.approx(colour.overlap(other, one))
    assert colour.overlap(one, other) < 0.01


def test_brighter_by_some_bins_and_back_is_the_same() -> None:
    shares = density(noisy(GREY_BROWN))
    there = colour.shifted(shares, 5)
    assert colour.brightness(there) == pytest.approx(colour.brightness(shares) + 5, abs=1e-3)
    assert colour.shifted(there, -5) == pytest.approx(shares)


def test_floor_of_two_colours_is_floor_and_a_third_is_an_obstacle() -> None:
    light, dark = np.array([150.0, 170.0, 180.0]), np.array([60.0, 62.0, 90.0])
    floor = density(np.concatenate([noisy(light), noisy(dark)]))
    found = evidence(floor, bins_of(np.array([light, dark, [60.0, 160.0, 60.0]])))
    assert np.all(found[:2] < -1.0)
    assert found[2] == pytest.approx(3.0)


def test_densities_of_obstacles_are_densities() -> None:
    assert np.exp(LOG_PRIOR.astype(float)).sum() == pytest.approx(1.0, abs=1e-4)
    floor, above = density(noisy(GREY_BROWN)), density(noisy(GREY_BROWN[::-1]))
    logs = colour.log_densities(floor, above, LOG_PRIOR).astype(float)
    assert logs[colour.THING] == pytest.approx(LOG_PRIOR)
    walls = 0.5 * (np.exp(LOG_PRIOR.astype(float)) + above)
    assert np.exp(logs[colour.WALL]) == pytest.approx(walls, rel=1e-3, abs=1e-9)
    # Floor is as dense as it was seen, or half as dense as what is a little darker.
    cube = floor.reshape(-1, colour.L_BINS)
    darker = [np.pad(cube, ((0, 0), (k, 0)))[:, : colour.L_BINS] / 2 for k in (1, 2)]
    core = np.max([cube, *darker], axis=0).ravel() + 1e-3 * np.exp(LOG_PRIOR.astype(float))
    assert np.exp(logs[colour.FLOOR]) == pytest.approx(core, rel=1e-3, abs=1e-9)


def test_a_sharp_shadow_and_the_sun_are_told_as_such() -> None:
    floor = density(noisy(GREY_BROWN))
    found = evidence(floor, bins_of(np.array([0.6 * GREY_BROWN, GREY_BROWN, 1.7 * GREY_BROWN])))
    assert found[0] == colour.SHADOWED
    assert found[1] < -2.0
    assert found[2] == colour.LIT
    # What is darker than any shadow is no floor.
    assert evidence(floor, bins_of(np.array([0.12 * GREY_BROWN])))[0] > 1.0


def test_light_that_changes_slowly_over_the_floor_stays_floor() -> None:
    floor = density(noisy(GREY_BROWN))
    logs = colour.log_densities(floor, NONE, LOG_PRIOR)
    gains = np.exp(np.linspace(0.0, -0.7, 40))
    rows = np.repeat(bins_of(gains[:, None] * GREY_BROWN)[:, None], 30, axis=1)
    slowly, _ = colour.evidence(logs, rows.astype(np.int32))
    assert np.all(slowly < -1.0)
    at_once, _ = colour.evidence(logs, rows[::39].astype(np.int32))
    assert np.all(at_once[1] == colour.SHADOWED)


def test_an_obstacle_in_the_floor_does_not_change_the_light() -> None:
    floor = density(noisy(GREY_BROWN))
    logs = colour.log_densities(floor, NONE, LOG_PRIOR)
    rows = np.repeat(bins_of(np.repeat(GREY_BROWN[None], 20, axis=0))[:, None], 40, axis=1)
    rows[5:15, 10:30] = bins_of(np.array([[40.0, 60.0, 200.0]]))[0]
    found, _ = colour.evidence(logs, rows.astype(np.int32))
    assert np.all(found[5:15, 10:30] > 2.0)
    assert np.all(np.delete(found, np.s_[10:30], axis=1) < -1.0)
    assert np.all(found[15:] < -1.0)


def test_what_reaches_above_the_horizon_in_a_colour_near_the_floors_is_a_wall() -> None:
    floor = density(noisy(GREY_BROWN))
    wall = 1.35 * GREY_BROWN + [6.0, 0.0, 0.0]
    logs = colour.log_densities(floor, density(noisy(wall)), LOG_PRIOR)
    seen = bins_of(wall[None])[None].astype(np.int32)
    any_thing, as_wall = colour.evidence(logs, seen)
    assert as_wall[0, 0] > any_thing[0, 0]
    assert as_wall[0, 0] > 1.0


def test_overexposed_floor_speaks_for_nothing() -> None:
    floor = density(noisy(GREY_BROWN))
    assert evidence(floor, bins_of(np.array([[255.0, 255.0, 255.0]])))[0] < 0.0
    # The red channel is full before the others: the ratios are no longer those of the floor.
    assert evidence(floor, bins_of(np.array([[200.0, 240.0, 255.0]])))[0] < 0.0
