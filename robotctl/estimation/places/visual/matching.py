"""Which feature of one image is which of another, by descriptors alone."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.estimation.places.visual.bits import BITS, differing_bits

MOST_BITS: Final = 64
"""Bits by which two sights of a corner differ at most: a quarter of all."""
RATIO: Final = 0.8
"""Maximum ratio of the best match to the next best (Lowe, IJCV 60(2), 2004)."""


@compiled
def match(
    descriptors_a: NDArray[np.uint64],
    groups_a: NDArray[np.int64],
    descriptors_b: NDArray[np.uint64],
    groups_b: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Return pairs of features of one group that match, (k, 2); each feature is in one at most.

    Groups are of the vocabulary's tree, so most comparisons are spared. The features of
    both images must be sorted by them.
    """
    best_of_b = np.full(len(descriptors_b), BITS, np.int64)
    partner = np.full(len(descriptors_b), -1, np.int64)
    begin = 0
    for i in range(len(descriptors_a)):
        group = groups_a[i]
        while begin < len(groups_b) and groups_b[begin] < group:
            begin += 1
        least, second, nearest = BITS, BITS, -1
        j = begin
        while j < len(groups_b) and groups_b[j] == group:
            bits = differing_bits(descriptors_a[i], descriptors_b[j])
            if bits < least:
                least, second, nearest = bits, least, j
            elif bits < second:
                second = bits
            j += 1
        is_clear = least <= MOST_BITS and least < RATIO * second
        if is_clear and least < best_of_b[nearest]:
            best_of_b[nearest] = least
            partner[nearest] = i
    matched = np.flatnonzero(partner >= 0)
    pairs = np.empty((len(matched), 2), np.int64)
    pairs[:, 0] = partner[matched]
    pairs[:, 1] = matched
    return pairs
