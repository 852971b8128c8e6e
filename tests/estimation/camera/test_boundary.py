"""Boundaries of which the true place is known, to parts of a row."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import erf

from robotctl.estimation.camera import colour
from robotctl.estimation.camera.boundary import (
    BLOCKED,
    FOUND,
    FREE,
    UNCLEAR,
    UNSEEN,
    Boundary,
    find_boundary,
    judge_lights,
    wall_feet,
)

COLUMNS, ROWS, CELL = 30, 96, 4
CELLS = ROWS // CELL
EDGES = np.arange(CELLS + 1) * CELL
HORIZON = CELLS - 4
FLOOR, BOX = np.array([90.0, 110.0, 130.0]), np.array([40.0, 60.0, 190.0])


def step_strip(places: np.ndarray, sigma: float, noise: float, seed: int = 0) -> np.ndarray:
    """A strip of floor and obstacle with blurred steps at rows of each column."""
    at = np.repeat(places, 2)[None] - 0.5
    share = 0.5 * (1.0 + erf((np.arange(ROWS)[:, None] - at) / sigma / np.sqrt(2.0)))
    strip = FLOOR + share[..., None] * (BOX - FLOOR)
    strip += np.random.default_rng(seed).normal(0.0, noise, strip.shape)
    return np.clip(np.rint(strip), 0, 255).astype(np.uint8)


def boundary_of(
    strip: np.ndarray,
    evidence: np.ndarray,
    walls: np.ndarray | None = None,
    first: int = 0,
    beyond: int = CELLS,
) -> Boundary:
    means, _ = colour.colour_bins(strip, EDGES, np.zeros(CELLS, np.intp))
    return find_boundary(
        evidence,
        evidence if walls is None else walls,
        strip,
        means,
        EDGES,
        np.full(COLUMNS, first),
        np.full(COLUMNS, beyond),
        HORIZON,
        HORIZON,
    )


def evidence_of(places: np.ndarray) -> np.ndarray:
    """Evidence of the coarse cells: floor before the step, obstacle from it on."""
    cells = np.arange(CELLS)[:, None]
    return np.where((cells + 0.5) * CELL > places, 3.0, -3.0).astype(np.float32)


@pytest.mark.parametrize("sigma", [0.5, 0.9])
def test_a_blurred_step_is_found_to_a_tenth_of_a_row(sigma: float) -> None:
    places = np.linspace(40.0, 43.0, COLUMNS)
    found = boundary_of(step_strip(places, sigma, 0.5), evidence_of(places))
    assert np.all(found.kinds == FOUND)
    # Three columns are averaged, so the ends of the slope are a little off.
    assert found.rows[1:-1] + 0.5 == pytest.approx(places[1:-1], abs=0.1)


def test_stated_noise_grows_with_that_of_the_picture_and_covers_the_error() -> None:
    places = np.full(COLUMNS, 50.3)
    small = boundary_of(step_strip(places, 0.7, 1.0), evidence_of(places))
    large = boundary_of(step_strip(places, 0.7, 12.0), evidence_of(places))
    assert np.median(large.noise_rows) > 3.0 * np.median(small.noise_rows)
    error = np.abs(large.rows + 0.5 - places)
    assert np.mean(error < 3.0 * np.hypot(large.noise_rows, 0.1)) > 0.9


def test_the_lowest_boundary_counts_and_specks_do_not() -> None:
    places = np.full(COLUMNS, 60.0)
    evidence = evidence_of(places)
    evidence[6, 3] = 3.0
    evidence[9:11, 15:20] = 3.0
    found = boundary_of(step_strip(places, 0.7, 1.0), evidence)
    assert np.all(found.cells[:14] == 15)
    assert np.all(found.cells[15:20] == 9)
    assert found.cells[25] == 15


def test_what_is_not_floor_from_the_first_row_on_is_blocked() -> None:
    evidence = np.full((CELLS, COLUMNS), 3.0, np.float32)
    found = boundary_of(step_strip(np.zeros(COLUMNS), 0.7, 1.0), evidence, first=2)
    assert np.all(found.kinds == BLOCKED)


def test_floor_up_to_the_horizon_is_free_only_if_what_is_above_differs() -> None:
    evidence = np.full((CELLS, COLUMNS), -3.0, np.float32)
    strip = step_strip(np.full(COLUMNS, 200.0), 0.7, 1.0)
    walls = evidence.copy()
    assert np.all(boundary_of(strip, evidence, walls).kinds == UNCLEAR)
    walls[HORIZON:, :10] = 2.0
    found = boundary_of(strip, evidence, walls).kinds
    assert np.all(found[:8] != UNCLEAR)
    assert np.all(found[12:] == UNCLEAR)
    walls[HORIZON:] = -0.1
    walls[HORIZON + 1 :] = 0.1
    assert np.all(boundary_of(strip, evidence, walls).kinds == FREE)


def test_where_the_picture_ends_before_the_horizon_nothing_is_said() -> None:
    evidence = np.full((CELLS, COLUMNS), -3.0, np.float32)
    strip = step_strip(np.full(COLUMNS, 200.0), 0.7, 1.0)
    assert np.all(boundary_of(strip, evidence, beyond=10).kinds == UNSEEN)
    assert np.all(boundary_of(strip, evidence, first=CELLS).kinds == UNSEEN)


def test_a_wall_hardly_unlike_the_floor_is_found_by_all_of_its_height() -> None:
    rng = np.random.default_rng(5)
    foot = 9
    walls = np.where(np.arange(CELLS)[:, None] >= foot, 0.5, -0.8)
    walls = (walls + rng.normal(0.0, 0.5, (CELLS, COLUMNS))).astype(np.float32)
    feet = wall_feet(walls, HORIZON)
    assert np.mean(np.abs(feet - foot) <= 1) > 0.9


def test_no_wall_is_seen_in_floor_and_none_without_a_horizon() -> None:
    floor = np.random.default_rng(6).normal(-0.5, 0.5, (CELLS, COLUMNS)).astype(np.float32)
    assert np.all(wall_feet(floor, HORIZON) == CELLS)
    assert np.all(wall_feet(np.full((CELLS, COLUMNS), 2.0, np.float32), CELLS) == CELLS)


def lights(dark_bins: int, light: float, *, caster: bool) -> np.ndarray:
    """Evidence, judged, of floor with a blob of another light, and perhaps a thing beside it."""
    evidence = np.full((CELLS, COLUMNS), -2.0, np.float32)
    bins = np.full((CELLS, COLUMNS), 30, np.int32)
    evidence[6:10, 10:16] = light
    bins[6:10, 10:16] += dark_bins
    if caster:
        evidence[6:12, 16:20] = 3.0
    judge_lights(evidence, bins, np.full(CELLS, 12.0))
    return evidence[6:10, 10:16]


def test_a_shadow_beside_what_casts_it_is_floor() -> None:
    assert np.all(lights(-8, colour.SHADOWED, caster=True) == colour.SHADOWED)


def test_a_small_dark_blob_with_a_sharp_edge_that_nothing_casts_is_a_thing() -> None:
    assert np.all(lights(-8, colour.SHADOWED, caster=False) > 1.0)
    assert np.all(lights(-3, colour.SHADOWED, caster=False) == colour.SHADOWED)


def test_a_small_bright_blob_with_a_sharp_edge_is_a_thing_whatever_is_beside_it() -> None:
    assert np.all(lights(8, colour.LIT, caster=True) > 1.0)
    assert np.all(lights(3, colour.LIT, caster=False) == colour.LIT)


def test_overexposed_floor_is_no_thing() -> None:
    assert np.all(lights(colour.SATURATED_BIN - 30, colour.LIT, caster=False) == colour.LIT)


def test_a_wide_shadow_is_a_shadow() -> None:
    evidence = np.full((CELLS, COLUMNS), -2.0, np.float32)
    bins = np.full((CELLS, COLUMNS), 30, np.int32)
    evidence[6:10, 3:27], bins[6:10, 3:27] = colour.SHADOWED, 20
    judge_lights(evidence, bins, np.full(CELLS, 12.0))
    assert np.all(evidence[6:10, 3:27] == colour.SHADOWED)
