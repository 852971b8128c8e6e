"""Junctions: places where corridors meet, branch or turn.

Floor is corridor where it runs straight on for longer than `LONG` times its width, which is that of
the largest free circle over a spot (local thickness: Hildebrand and Rüegsegger, Journal of
Microscopy 185(1), 1997). Where it does so in two directions that are `APART_DEG` apart or more,
corridors meet; junctions that touch, as along a row of shelves, are divided at the necks between
them. Only floor off the walls counts, so niches, door frames and the ragged walls of a
scanned map do not.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage  # type: ignore[import-untyped]

from robotctl.planning.map.topological.graph import PlaceKind
from robotctl.planning.map.topological.regions import floor_regions

LONG: Final = 2.5
APART_DEG: Final = 45.0
_GRID_M: Final = 0.1
"""Side of the cells that are looked at."""
_CORE_M: Final = 0.35
_CORE: Final = 0.2
"""Floor counts that is so far off the walls, and by so much of its width."""
_DOOR_M: Final = 1.2
"""A corridor ends at a passage that is narrower; a thing that stands in it does not end it."""
_SHARE: Final = 1.0 / 3.0
"""Share of a region beside a junction that has to run straight on for it to be a corridor."""
_NECK: Final = 0.9
"""Largest width between two junctions that touch, as a share of the lesser of their widths."""
_SMOOTH_M: Final = 0.15
"""Smaller gaps where corridors meet are filled, smaller parts left out."""
_DIRECTIONS: Final = 36
_FINER: Final = 1.1
"""Ratio of the circles that widths are measured with."""
_EIGHT: Final = np.ones((3, 3), np.bool_)

Mask = NDArray[np.bool_]


def with_junctions(
    labels: NDArray[np.int64], depth_m: NDArray[np.float64], side_m: float
) -> tuple[NDArray[np.int64], dict[int, PlaceKind]]:
    """Give junctions, and what they divide, regions of their own.

    Parameters
    ----------
    labels
        (rows, columns): region of each cell, -1 for none.
    depth_m
        Distance of each cell from the walls [m].
    side_m
        Of a cell [m].

    Returns
    -------
    tuple
        Labels like the given ones, and the kinds of regions where they are known: junctions, and
        corridors beside them.
    """
    is_corridor, meets = _corridors(labels, depth_m, side_m)
    meets = _from_wall_to_wall(meets, labels >= 0, depth_m, side_m)
    pieces = _pieces(labels, meets)
    for piece in _beside(meets, pieces):
        cells = pieces == piece
        width_m = 2.0 * float(depth_m[cells].max())
        is_short = np.count_nonzero(cells) * side_m**2 < width_m**2
        if is_short and not (_around(cells) & (pieces >= 0)).any():
            meets |= cells
    _drop_ends(meets, labels >= 0, is_corridor)
    if not meets.any():
        return labels, {}
    pieces = _pieces(labels, meets)
    junctions = floor_regions(np.where(meets, depth_m, 0.0), side_m, math.inf, _NECK)
    unused = int(pieces.max()) + 1
    kinds: dict[int, PlaceKind] = dict.fromkeys(
        range(unused, unused + int(junctions.max()) + 1), "junction"
    )
    for piece in _beside(meets, pieces):
        if is_corridor[pieces == piece].mean() > _SHARE:
            kinds[piece] = "corridor"
    return np.where(meets, junctions + unused, pieces), kinds


def _around(cells: Mask) -> Mask:
    """Return the cells beside some."""
    grown: Mask = ndimage.binary_dilation(cells, _EIGHT)
    return grown & ~cells


def _beside(meets: Mask, pieces: NDArray[np.int64]) -> list[int]:
    """Return the regions beside junctions."""
    found: list[int] = np.unique(pieces[_around(meets)]).tolist()
    return [each for each in found if each >= 0]


def _pieces(labels: NDArray[np.int64], meets: Mask) -> NDArray[np.int64]:
    """Return regions without junctions; what these divide are regions of their own."""
    pieces = np.where(meets, -1, labels)
    unused = int(labels.max()) + 1
    for region in np.unique(labels[meets & (labels >= 0)]).tolist():
        parts, count = ndimage.label(pieces == region, _EIGHT)
        pieces[parts > 0] = parts[parts > 0] + (unused - 1)
        unused += count
    return pieces


def _corridors(
    labels: NDArray[np.int64], depth_m: NDArray[np.float64], side_m: float
) -> tuple[Mask, Mask]:
    """Return the cells that are in a corridor, and those where two of them meet."""
    step = max(1, round(_GRID_M / side_m))
    thin = (slice(None, None, step), slice(None, None, step))
    floor, depth = labels[thin] >= 0, depth_m[thin]
    width_m = _width_m(floor, depth, side_m * step)
    core = floor & (depth >= np.maximum(_CORE_M, _CORE * width_m))
    least = ndimage.minimum_filter(labels[thin], 3)
    is_border = (least >= 0) & (ndimage.maximum_filter(labels[thin], 3) > least)
    core &= ~is_border | (depth >= 0.5 * _DOOR_M)
    is_corridor, meets = np.zeros((2, *labels.shape), np.bool_)
    if not core.any():
        return is_corridor, meets
    straight_m = _runs(core) * (side_m * step) + 2.0 * _CORE_M
    is_long = straight_m >= LONG * width_m[core]
    turns = np.abs(np.arange(_DIRECTIONS)[:, None] - straight_m.argmax(axis=0))
    is_apart = np.minimum(turns, _DIRECTIONS - turns) * 180.0 / _DIRECTIONS >= APART_DEG
    found = np.zeros((2, *core.shape), np.bool_)
    found[:, core] = is_long.any(axis=0), (is_long & is_apart).any(axis=0)
    # What lies between core and wall is as the nearest of the core.
    cores = np.zeros_like(meets)
    cores[thin], is_corridor[thin] = core, found[0]
    meets[thin] = _smooth(found[1], _SMOOTH_M / (side_m * step))
    nearest = ndimage.distance_transform_edt(~cores, return_distances=False, return_indices=True)
    is_floor = labels >= 0
    return is_corridor[tuple(nearest)] & is_floor, meets[tuple(nearest)] & is_floor


def _width_m(floor: Mask, depth_m: NDArray[np.float64], side_m: float) -> NDArray[np.float64]:
    """Return the diameter of the largest free circle over each cell; 0 below `2 * _CORE_M`."""
    width_m = np.zeros(floor.shape)
    radius_m = _CORE_M
    while (middles := floor & (depth_m >= radius_m)).any():
        width_m[ndimage.distance_transform_edt(~middles) * side_m <= radius_m] = 2.0 * radius_m
        radius_m *= _FINER
    return width_m


def _runs(free: Mask) -> NDArray[np.float32]:
    """Return how far free cells reach straight through each free cell [cells].

    Returns
    -------
    NDArray
        (directions, free cells): half a turn, counter-clockwise.
    """
    result = np.empty((_DIRECTIONS, np.count_nonzero(free)), np.float32)
    for direction in range(_DIRECTIONS):
        angle_rad = math.pi * direction / _DIRECTIONS
        along, across = math.cos(angle_rad), math.sin(angle_rad)
        if abs(along) >= abs(across):
            runs = _sheared_runs(free, across / along)
        else:
            runs = _sheared_runs(free.T, along / across).T
        result[direction] = runs[free]
    return result


def _sheared_runs(free: Mask, slope: float) -> NDArray[np.float64]:
    """Return the length of each cell's run along lines that rise by `slope` rows a column."""
    rows, columns = free.shape
    number = np.arange(columns)
    shift = np.round(-slope * number).astype(np.int64)
    row = np.arange(rows)[:, None] + (shift - shift.min())
    level = np.zeros((rows + int(np.ptp(shift)), columns), np.bool_)
    level[row, number] = free
    before = np.maximum.accumulate(np.where(level, -1, number), axis=1)
    beyond = np.where(level, columns, number)[:, ::-1]
    beyond = np.minimum.accumulate(beyond, axis=1)[:, ::-1]
    runs: NDArray[np.float64] = (beyond - before - 1)[row, number] * math.hypot(1.0, slope)
    return runs


def _smooth(cells: Mask, radius: float) -> Mask:
    """Close small gaps, then leave small parts out."""
    margin = math.ceil(radius) + 1
    cells = np.pad(cells, margin)
    for shrinks in (False, True, True, False):
        away = ndimage.distance_transform_edt(cells if shrinks else ~cells)
        cells = away > radius if shrinks else away <= radius
    return cells[margin:-margin, margin:-margin]


def _from_wall_to_wall(
    meets: Mask, floor: Mask, depth_m: NDArray[np.float64], side_m: float
) -> Mask:
    """Return junctions with what the largest circles in them cover, up to the corners."""
    whole = meets.copy()
    pieces, count = ndimage.label(meets, _EIGHT)
    for piece in range(1, count + 1):
        cells = pieces == piece
        widest_m = float(depth_m[cells].max())
        for radius_m in (widest_m, 0.95 * widest_m, 0.9 * widest_m):
            away = ndimage.distance_transform_edt(~(cells & (depth_m >= radius_m)))
            whole |= floor & (away * side_m <= radius_m)
    return whole


def _drop_ends(meets: Mask, floor: Mask, is_corridor: Mask) -> None:
    """Leave out junctions that fewer than two corridors lead off."""
    junctions, count = ndimage.label(meets, _EIGHT)
    for junction in range(1, count + 1):
        cells = junctions == junction
        ways, number = ndimage.label(_around(cells) & floor & ~meets, _EIGHT)
        shares = ndimage.mean(is_corridor, ways, np.arange(1, number + 1))
        if np.count_nonzero(np.array(shares) > 0.5) < 2:
            meets &= ~cells
