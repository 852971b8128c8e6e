"""Which segments are near a place: a list for each cell of a coarse grid, nearest first."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

_CELL_M: Final = 0.5
"""Side of a cell [m]."""
_CELLS: Final = 5000
"""Cells at most, about: those of a large map are larger."""


class NearIndex:
    """Lists of segments within reach of each cell.

    Parameters
    ----------
    segments
        (m, 4) [m]: A x, A y, B x, B y; A and B may be the same.
    reach_m
        Segments farther than this from a cell are not in its list [m].
    like
        Another index whose cells to use.

    Attributes
    ----------
    lists
        Start of the list of each cell, (cells + 1,); numbers of the segments, all lists in a
        row; and below which distance of any place in the cell the segment cannot be [m].
    """

    def __init__(
        self, segments: NDArray[np.float64], reach_m: float, like: NearIndex | None = None
    ) -> None:
        if like is None:
            points = segments.reshape(-1, 2)
            self._low = points.min(axis=0) - reach_m
            size = points.max(axis=0) + reach_m - self._low
            self._side_m = max(_CELL_M, math.sqrt(float(np.prod(size)) / _CELLS))
            self._shape = np.ceil(size / self._side_m).astype(np.intp)
        else:
            self._low, self._side_m, self._shape = like._low, like._side_m, like._shape
        self.lists = self._lists(segments, reach_m)

    def cells_of(self, poses: NDArray[np.float64]) -> NDArray[np.intp]:
        """Return the cell of each pose (n, 3), (n,); the last one, of an empty list, outside."""
        at = np.floor((poses[:, :2] - self._low) / self._side_m)
        inside = np.all((at >= 0) & (at < self._shape), axis=1)
        cells = at[:, 1] * self._shape[0] + at[:, 0]
        found: NDArray[np.intp] = np.where(inside, cells, np.prod(self._shape)).astype(np.intp)
        return found

    def _lists(
        self, segments: NDArray[np.float64], reach_m: float
    ) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float64]]:
        columns, rows = (np.arange(n) + 0.5 for n in self._shape)
        centres = np.stack(np.meshgrid(columns, rows), axis=2).reshape(-1, 2) * self._side_m
        half_diagonal = self._side_m * math.sqrt(0.5)
        bound = distances(centres + self._low, segments) - half_diagonal
        order = np.argsort(bound, axis=1)
        ordered = np.take_along_axis(bound, order, axis=1)
        near = ordered <= reach_m
        starts = np.zeros(len(centres) + 2, np.int64)
        starts[1:-1] = np.cumsum(near.sum(axis=1))
        starts[-1] = starts[-2]
        return starts, order[near].astype(np.int32), ordered[near]


def distances(points: NDArray[np.float64], segments: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance of each point (n, 2) from each segment (m, 4), (n, m)."""
    a, way = segments[:, :2], segments[:, 2:] - segments[:, :2]
    off = points[:, np.newaxis] - a
    squared = np.maximum(np.sum(way * way, axis=1), np.finfo(float).tiny)
    share = np.clip(np.sum(off * way, axis=2) / squared, 0.0, 1.0)
    rest = off - share[..., np.newaxis] * way
    found: NDArray[np.float64] = np.hypot(rest[..., 0], rest[..., 1])
    return found
