"""How many bits two descriptors differ by, in compiled code."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled

BITS = 256
"""Bits of a descriptor."""


@compiled
def differing_bits(a: NDArray[np.uint64], b: NDArray[np.uint64]) -> int:
    """Return the Hamming distance of two descriptors, (4,) each, by adding up bits in parallel."""
    total = 0
    for i in range(4):
        x = a[i] ^ b[i]
        x = x - ((x >> np.uint64(1)) & np.uint64(0x5555555555555555))
        x = (x & np.uint64(0x3333333333333333)) + (
            (x >> np.uint64(2)) & np.uint64(0x3333333333333333)
        )
        x = (x + (x >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
        total += int((x * np.uint64(0x0101010101010101)) >> np.uint64(56))
    return total
