"""Check that the free patch is free before the floor is learned from it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.camera.colour import C_BINS, L_BINS
from robotctl.estimation.camera.config import FloorLookConfig

PARTS: Final = 3
"""Number of parts of the patch to compare, in depth and across."""
_COARSER_RATIO: Final = 2
_COARSER_LIGHT: Final = 4
"""Bins of ratios and of brightness that one bin of the comparison takes together."""


@dataclass(frozen=True, slots=True, eq=False)
class PatchVerdict:
    """Verdict on the free patch.

    Attributes
    ----------
    bins
        Colours that the patch has in several places, (n,).
    why
        Why the floor must not be learned from it; empty: it may.
    """

    bins: NDArray[np.int32]
    why: str = ""


def judge_patch(
    bins: NDArray[np.int32],
    means: NDArray[np.float32],
    parts: NDArray[np.int8],
    config: FloorLookConfig = FloorLookConfig(),  # noqa: B008
) -> PatchVerdict:
    """Return the part of the patch that is floor, judged from the patch alone.

    Each part must look like the others, and what is farther like what is nearer: an obstacle that
    stands in the patch covers its far side first.

    Parameters
    ----------
    bins
        Places of the colours in a histogram, (n, columns).
    means
        The colours, BGR, (n, columns, 3).
    parts
        Which part of the patch a cell belongs to, nearest row first; -1: none, (n, columns).
    config
        Settings.
    """
    inside = parts >= 0
    which = parts[inside].astype(np.intp)
    mine, colours = bins[inside], means[inside]
    if np.mean(colours.min(axis=1) > config.overexposed_above) > config.blind_share:
        return PatchVerdict(mine[:0], "the floor in front is overexposed")
    if np.mean(colours.max(axis=1) < config.dark_below) > config.blind_share:
        return PatchVerdict(mine[:0], "the floor in front is too dark to be distinguished")
    place, cubes = _small_histograms(mine, which)
    kept = np.zeros(len(mine), np.bool_)
    alike = np.ones(PARTS * PARTS, np.bool_)
    total = cubes.sum(axis=0)
    nearer, row = np.zeros_like(total), np.zeros_like(total)
    for part in range(PARTS * PARTS):
        if part % PARTS == 0:
            nearer, row = nearer + row, np.zeros_like(total)
        common = _seen_in(total - cubes[part], config.colour_share_min)
        if part >= PARTS:
            common &= _seen_in(nearer, config.colour_share_min)
        # Only kept parts support farther ones.
        row += np.where(common, cubes[part], np.float32(0.0))
        here = which == part
        kept[here] = common.reshape(-1)[place[here]]
        alike[part] = np.mean(kept[here]) >= config.part_share_min
    if np.sum(~alike) >= config.misfits:
        return PatchVerdict(
            mine[:0],
            "the floor in front is not uniform: something may stand there",
        )
    return PatchVerdict(mine[kept])


def _small_histograms(
    bins: NDArray[np.int32], which: NDArray[np.intp]
) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """Return a coarser bin for each colour, and a histogram of these bins for each part."""
    light, ratios = bins % L_BINS, bins // L_BINS
    per = (_COARSER_RATIO, _COARSER_RATIO, _COARSER_LIGHT)
    shape = (C_BINS // per[0], C_BINS // per[1], L_BINS // per[2])
    place = np.ravel_multi_index(
        (ratios // C_BINS // per[0], ratios % C_BINS // per[1], light // per[2]), shape
    )
    size = int(np.prod(shape))
    counted = np.bincount(which * size + place, minlength=PARTS * PARTS * size)
    return place, counted.astype(np.float32).reshape(PARTS * PARTS, *shape)


def _seen_in(others: NDArray[np.float32], least: float) -> NDArray[np.bool_]:
    """Return for each colour whether a histogram has a share of it or a neighbour."""
    wide = cv2.dilate(np.ascontiguousarray(others), np.ones((3, 3), np.uint8))
    flat = wide.reshape(-1, wide.shape[-1])
    near = cv2.dilate(flat, np.ones((1, 3), np.uint8)).reshape(others.shape)
    common: NDArray[np.bool_] = near >= least * others.sum()
    return common
