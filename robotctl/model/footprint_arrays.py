"""A robot's outline as arrays: its sides, circles that cover it, points of it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.model.footprint import Footprint
from robotctl.model.polygons import Point, Side, sides_of

Sides: TypeAlias = NDArray[np.float64]
"""(n, 7), a row for each side of each convex piece of a body: its unit normal, which points
outwards; its distance from `base`; from where to where it goes along the normal turned to the left
[m]; the number of its piece; 1 if the whole body is on its inner side. If there are several pieces,
rows of number `OPEN` follow, for the sides beyond which there is nothing of the body."""
OFFSET: Final = 2
"""Column of the distances."""
PIECE: Final = 5
"""Column of the pieces' numbers."""
HULL: Final = 6
"""Column that says whether the whole body is on the inner side."""
OPEN: Final = -1.0

_ON_HULL_M: Final = 1e-6
_MOST_DISCS: Final = 32
"""Circles that cover a piece at most: a sliver would need any number."""
_SHARP: Final = -1e-9
"""Cosine of the turn at a corner below which a piece gets a further side there: 90 degrees."""


def side_rows(footprint: Footprint) -> Sides:
    """Return the sides of an outline, as kernels take them.

    At a sharp corner of one of several pieces lies a further side, of length 0: a piece that is
    grown reaches out there no farther than the body's own corners do.
    """
    points = footprint.points
    rows = []
    for number, piece in zip(itertools.count(0.0), footprint.pieces, strict=False):
        sides = sides_of(piece)
        for side, following in zip(sides, [*sides[1:], *sides[:1]], strict=True):
            row = _row(side)
            rows.append((*row, number, _is_on_hull(row, points)))
            if not footprint.is_convex:
                rows += [(*each, number, 0.0) for each in _across(row, _row(following), side[1])]
    if not footprint.is_convex:
        rows += [(*_row(side), OPEN, 0.0) for side in footprint.open_sides]
    return np.array(rows).reshape(-1, 7)


def covers(body: Sides, points: NDArray[np.float64], margin_m: float = 0.0) -> NDArray[np.bool_]:
    """Return which points (n, 2) of `base` lie in a body that is grown by a margin, (n,) [m]."""
    inside = points @ body[:, :OFFSET].T - body[:, OFFSET] < margin_m
    covered = np.zeros(len(points), np.bool_)
    for piece in range(1 + int(body[:, PIECE].max(initial=OPEN))):
        covered |= inside[:, body[:, PIECE] == piece].all(axis=1)
    return covered


def _row(side: Side) -> tuple[float, float, float, float, float]:
    """Return normal, distance, and from where to where of a side."""
    (ax, ay), (bx, by) = side
    length = math.dist((ax, ay), (bx, by))
    nx, ny = (by - ay) / length, (ax - bx) / length
    return nx, ny, nx * ax + ny * ay, nx * ay - ny * ax, nx * by - ny * bx


def _across(
    one: Sequence[float], other: Sequence[float], corner: Point
) -> list[tuple[float, float, float, float, float]]:
    """Return the row of a side of length 0 between two others; none if it is not sharp there."""
    if one[0] * other[0] + one[1] * other[1] >= _SHARP:
        return []
    nx, ny = one[0] + other[0], one[1] + other[1]
    length = math.hypot(nx, ny)
    if length < 1e-6:
        nx, ny, length = -one[1], one[0], 1.0
    nx, ny = nx / length, ny / length
    at = nx * corner[1] - ny * corner[0]
    return [(nx, ny, nx * corner[0] + ny * corner[1], at, at)]


def _is_on_hull(row: Sequence[float], points: Iterable[Point]) -> float:
    """Return 1 if all points are on the inner side of a row, else 0."""
    return float(all(row[0] * x + row[1] * y <= row[OFFSET] + _ON_HULL_M for x, y in points))


def discs(footprint: Footprint) -> NDArray[np.float64]:
    """Return circles that cover the body, (n, 3): x, y, r; of each piece along its longer side."""
    if not footprint.corners:
        return np.zeros((1, 3))
    return np.concatenate([discs_over(piece) for piece in footprint.pieces])


def discs_over(piece: Sequence[Point]) -> NDArray[np.float64]:
    """Return circles that cover a piece, in a row."""
    low, high = np.min(piece, axis=0), np.max(piece, axis=0)
    lengths = high - low
    longer = int(np.argmax(lengths))
    count = min(math.ceil(2.0 * lengths[longer] / lengths[1 - longer]), _MOST_DISCS)
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


def outlines(footprint: Footprint, scale: float, spacing: float) -> NDArray[np.float64]:
    """Return points round all polygons of a body, at most a spacing apart, (n, 2), [m] / scale."""
    return np.concatenate([outline(np.array(each) / scale, spacing) for each in footprint.outlines])


def samples(footprint: Footprint, spacing_m: float) -> NDArray[np.float64]:
    """Return points of the body, outline included, at most `spacing_m` apart, (n, 2) [m]."""
    if not footprint.corners:
        return np.zeros((1, 2))
    if footprint.is_convex:
        found = _samples(np.array(footprint.corners), spacing_m, footprint.reach_m)
    else:
        found = np.concatenate([_samples_of(piece, spacing_m) for piece in footprint.pieces])
    return np.unique(found.round(9), axis=0)


def _samples_of(piece: Sequence[Point], spacing_m: float) -> NDArray[np.float64]:
    """Return points of a piece, about its middle."""
    middle = np.mean(piece, axis=0)
    around = np.array(piece) - middle
    points: NDArray[np.float64] = middle + _samples(
        around, spacing_m, float(np.hypot(*around.T).max())
    )
    return points


def _samples(corners: NDArray[np.float64], spacing_m: float, reach_m: float) -> NDArray[np.float64]:
    """Return points of a convex polygon around the origin, outline included."""
    around = outline(corners, spacing_m)
    shrink = np.linspace(1.0, 0.0, max(1, math.ceil(reach_m / spacing_m)) + 1)
    return np.concatenate([around * s for s in shrink])


def inner_samples(footprint: Footprint, spacing_m: float, inwards_m: float) -> NDArray[np.float64]:
    """Return points of a body of several pieces, so far from its sides, (n, 2) [m].

    Those in the middle of a piece that is thinner than that are among them.
    """
    found = []
    for piece in footprint.pieces:
        points = _samples_of(piece, spacing_m)
        depths = _from_sides(points, footprint.open_sides)
        found.append(points[depths >= min(inwards_m, depths.max()) - _ON_HULL_M])
    return np.unique(np.concatenate(found).round(9), axis=0)


def _from_sides(points: NDArray[np.float64], sides: Iterable[Side]) -> NDArray[np.float64]:
    """Return the distance of points from the nearest of some sides, (n,) [m]."""
    nearest = np.full(len(points), math.inf)
    for a, b in np.array(list(sides)):
        along = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        away = points - a - along[:, np.newaxis] * (b - a)
        nearest = np.minimum(nearest, np.hypot(*away.T))
    return nearest
