"""What may be learned from the patch in front of the robot, and what must not."""

from __future__ import annotations

import numpy as np
import pytest

from robotctl.estimation.camera import colour
from robotctl.estimation.camera.patch import PARTS, PatchVerdict, judge_patch

ROWS, COLUMNS = 24, 30
FLOOR = np.array([90.0, 110.0, 130.0])
BOX = np.array([60.0, 150.0, 70.0])


def judged(cells: np.ndarray) -> tuple[PatchVerdict, np.ndarray]:
    """Judge a patch that fills a grid of cells, (ROWS, COLUMNS, 3) BGR."""
    noisy = cells + np.random.default_rng(1).normal(0.0, 2.0, cells.shape)
    strip = np.clip(np.rint(np.repeat(noisy, 2, axis=1)), 0, 255).astype(np.uint8)
    means, bins = colour.colour_bins(strip, np.arange(ROWS + 1), np.zeros(ROWS, np.intp))
    row, column = np.mgrid[0:ROWS, 0:COLUMNS]
    parts = (row * PARTS // ROWS * PARTS + column * PARTS // COLUMNS).astype(np.int8)
    return judge_patch(bins, means, parts), bins


def even(colour_bgr: np.ndarray = FLOOR) -> np.ndarray:
    return np.broadcast_to(colour_bgr, (ROWS, COLUMNS, 3)).copy()


def test_an_even_floor_is_learned_whole() -> None:
    verdict, _ = judged(even())
    assert not verdict.why
    assert len(verdict.bins) == ROWS * COLUMNS


def test_tiles_are_learned_in_both_colours() -> None:
    cells = even()
    i, j = np.mgrid[0:ROWS, 0:COLUMNS] // 4
    cells[(i + j) % 2 == 0] = 0.6 * FLOOR + [0.0, 0.0, 15.0]
    verdict, _ = judged(cells)
    assert not verdict.why
    assert len(verdict.bins) > 0.95 * ROWS * COLUMNS


@pytest.mark.parametrize(
    "covered", [np.s_[18:, 20:], np.s_[16:, :], np.s_[20:, :], np.s_[12:, 25:]]
)
def test_what_stands_in_the_far_part_is_not_learned(covered: tuple[slice, slice]) -> None:
    cells = even()
    cells[covered] = BOX
    verdict, bins = judged(cells)
    assert not verdict.why
    assert not np.any(np.isin(bins[covered], verdict.bins))
    assert len(verdict.bins) > 0.5 * ROWS * COLUMNS


def test_a_patch_of_many_looks_is_refused() -> None:
    cells = even()
    cells[8:, :] = BOX
    cells[16:, :] = [150.0, 80.0, 90.0]
    verdict, _ = judged(cells)
    assert "is not uniform" in verdict.why
    assert len(verdict.bins) == 0


@pytest.mark.parametrize(("level", "message"), [(255.0, "overexposed"), (2.0, "too dark")])
def test_a_patch_without_colours_is_refused(level: float, message: str) -> None:
    verdict, _ = judged(even(np.full(3, level)))
    assert message in verdict.why
