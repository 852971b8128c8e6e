"""The cells that a body covers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robotctl.model.footprint import Footprint
from robotctl.model.footprint_arrays import inner_samples


def cells_at(
    points: NDArray[np.float64], shape: tuple[int, int]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return rows and columns of points (n, 2) [cells] as far as they are on a map."""
    columns, rows = np.floor(points).astype(np.int64).T
    inside = (rows >= 0) & (rows < shape[0]) & (columns >= 0) & (columns < shape[1])
    return rows[inside], columns[inside]


def drawn_in(
    footprint: Footprint, samples: NDArray[np.float64], resolution_m: float
) -> NDArray[np.float64]:
    """Return points (n, 2) of a body, drawn inwards by a cell on each side [cells].

    `samples` are all its points [cells].
    """
    if footprint.is_convex:
        return shrunk(samples)
    return inner_samples(footprint, 0.5 * resolution_m, resolution_m) / resolution_m


def shrunk(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the points (n, 2) of a body, drawn inwards by a cell on each side [cells]."""
    low, high = points.min(axis=0), points.max(axis=0)
    share: NDArray[np.float64] = np.maximum(1.0 - 2.0 / np.maximum(high - low, 2.0), 0.0)
    middle = 0.5 * (low + high)
    inner: NDArray[np.float64] = middle + share * (points - middle)
    return inner
