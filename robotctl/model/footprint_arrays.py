"""A robot's outline as arrays: its sides, circles that cover it, points of it."""

from __future__ import annotations

import math
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.model.footprint import Footprint

Sides: TypeAlias = NDArray[np.float64]
"""(n, 5), a row for each side of a convex outline: its unit normal, which points outwards; its
distance from `base`; from where to where it goes along the normal turned to the left [m]."""
OFFSET: Final = 2
"""Column of the distances."""


def side_rows(footprint: Footprint) -> Sides:
    """Return the sides of an outline, as kernels take them."""
    rows = []
    for (ax, ay), (bx, by) in footprint.sides():
        length = math.dist((ax, ay), (bx, by))
        nx, ny = (by - ay) / length, (ax - bx) / length
        rows.append((nx, ny, nx * ax + ny * ay, nx * ay - ny * ax, nx * by - ny * bx))
    return np.array(rows).reshape(-1, 5)


def discs(footprint: Footprint) -> NDArray[np.float64]:
    """Return circles that cover the body, in a row along its longer side, (n, 3): x, y, r."""
    if not footprint.corners:
        return np.zeros((1, 3))
    low, high = np.min(footprint.corners, axis=0), np.max(footprint.corners, axis=0)
    lengths = high - low
    longer = int(np.argmax(lengths))
    count = math.ceil(2.0 * lengths[longer] / lengths[1 - longer])
    covering = np.empty((count, 3))
    covering[:, :2] = 0.5 * (low + high)
    covering[:, longer] = low[longer] + lengths[longer] * (np.arange(count) + 0.5) / count
    covering[:, 2] = 0.5 * math.hypot(lengths[longer] / count, lengths[1 - longer])
    return covering


def outline(corners: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """Return points round a polygon in order, at most a spacing apart, corners included, (m, 2)."""
    points = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        count = math.ceil(math.dist(a, b) / spacing)
        points.append(a + (b - a) * (np.arange(count) / count)[:, np.newaxis])
    return np.concatenate(points)


def samples(footprint: Footprint, spacing_m: float) -> NDArray[np.float64]:
    """Return points of the body, outline included, at most `spacing_m` apart, (n, 2) [m]."""
    if not footprint.corners:
        return np.zeros((1, 2))
    around = outline(np.array(footprint.corners), spacing_m)
    shrink = np.linspace(1.0, 0.0, max(1, math.ceil(footprint.reach_m / spacing_m)) + 1)
    return np.unique(np.concatenate([around * s for s in shrink]).round(9), axis=0)
