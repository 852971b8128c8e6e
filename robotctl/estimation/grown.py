"""Arrays that grow."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


class Grown:
    """An array that grows at its end."""

    __slots__ = ("array", "size")

    def __init__(self, shape: tuple[int, ...], dtype: Any) -> None:
        self.array = np.zeros((64, *shape), dtype)
        self.size = 0

    def add(self, rows: Any) -> int:
        """Append rows; return where they begin."""
        begin, count = self.size, len(rows)
        if begin + count > len(self.array):
            larger = np.zeros((2 * (begin + count), *self.array.shape[1:]), self.array.dtype)
            larger[:begin] = self.array[:begin]
            self.array = larger
        self.array[begin : begin + count] = rows
        self.size = begin + count
        return begin

    @property
    def view(self) -> NDArray[Any]:
        """View of the entries so far."""
        return self.array[: self.size]
