"""A binary heap in two arrays, for compiled searches: the least key comes first."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import borrows, compiled


@compiled
@borrows
def push(
    keys: NDArray[np.float64], items: NDArray[np.int32], count: int, key: float, item: int
) -> int:
    """Put an item into a binary heap of so many; return how many there are then."""
    at = count
    while at > 0:
        above = (at - 1) >> 1
        if keys[above] <= key:
            break
        keys[at], items[at] = keys[above], items[above]
        at = above
    keys[at], items[at] = key, item
    return count + 1


@compiled
@borrows
def pop(keys: NDArray[np.float64], items: NDArray[np.int32], count: int) -> int:
    """Take the item with the least key, which is returned, out of a heap of so many, at least 1."""
    top = items[0]
    last = count - 1
    key, item = keys[last], items[last]
    at = 0
    while True:
        below = 2 * at + 1
        if below >= last:
            break
        if below + 1 < last and keys[below + 1] < keys[below]:
            below += 1
        if keys[below] >= key:
            break
        keys[at], items[at] = keys[below], items[below]
        at = below
    keys[at], items[at] = key, item
    return int(top)
