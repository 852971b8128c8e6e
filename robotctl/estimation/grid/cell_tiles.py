"""Cells of a large area of which little is known, in tiles: only tiles with evidence exist."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

SIDE: Final = 64
"""Side of a tile [cells]."""


class CellTiles:
    """Tiles of int8 cells at multiples of `SIDE`; cells without a tile are 0."""

    def __init__(self) -> None:
        self._tiles: dict[tuple[int, int], NDArray[np.int8]] = {}

    def __len__(self) -> int:
        return len(self._tiles)

    def __iter__(self) -> Iterator[tuple[int, int, NDArray[np.int8]]]:
        """Yield first row and column of each tile, and its cells (`SIDE`, `SIDE`)."""
        for (row, column), cells in self._tiles.items():
            yield row, column, cells

    def put(self, cells: NDArray[np.int8], corner: NDArray[np.int64]) -> None:
        """Replace cells.

        Parameters
        ----------
        cells
            (rows, columns), both multiples of `SIDE`.
        corner
            Row and column of the first, multiples of `SIDE`.
        """
        rows, columns = (size // SIDE for size in cells.shape)
        blocks = cells.reshape(rows, SIDE, columns, SIDE)
        says = np.asarray(blocks.any(axis=(1, 3)))
        for row, column in np.ndindex(rows, columns):
            place = int(corner[0]) + row * SIDE, int(corner[1]) + column * SIDE
            if says[row, column]:
                self._tiles[place] = blocks[row, :, column].copy()
            else:
                self._tiles.pop(place, None)

    def fill(self, cells: NDArray[np.int8], corner: NDArray[np.int64]) -> None:
        """Fill zero cells from their tiles; see `put`."""
        first_row, first_column = (int(value) for value in corner)
        for row in range(first_row, first_row + cells.shape[0], SIDE):
            for column in range(first_column, first_column + cells.shape[1], SIDE):
                tile = self._tiles.get((row, column))
                if tile is not None:
                    r, c = row - first_row, column - first_column
                    cells[r : r + SIDE, c : c + SIDE] = tile
