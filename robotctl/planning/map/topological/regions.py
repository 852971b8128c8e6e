"""Regions of free floor: divided at narrow places, and where corridors, gaps and bays open."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage  # type: ignore[import-untyped]

DOOR_M: Final = 1.5
"""Width of the widest passage that divides."""
NECK: Final = 0.75
"""Largest width of a passage that divides, as a share of the lesser of the two regions' widths."""
HALL_M: Final = 8.0
"""Width from which on a room is a hall, which things that stand free divide [m]."""
CORRIDOR: Final = 3.0
"""Length over width from which on a place is a corridor."""
_NARROWER: Final = 0.5
"""Largest width of a corridor without a door, as a share of the open area's that it leads off."""
_NARROWER_IN_HALL: Final = 0.6
"""The same share of a hall's width, which what stands in the hall makes smaller."""
_AROUND_CELLS: Final = 10.0
"""Deviation of the weights by which floor around a cell counts [cells]."""
_FINER: Final = 0.8
"""Ratio of the circles by which bays of a hall are found."""
_CORRIDOR_WIDTH_M: Final = 1.0
"""Least width of such a corridor [m]."""
_DEEP: Final = 0.5
"""Least area of a bay of a hall over the square of its width."""
_MOUTH: Final = 1.5
"""Longest border of a bay to the hall over its width; that of a rounded corner is longer."""
_BESIDE: Final = ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1))
"""Rows and columns to the eight neighbours of a cell."""


def hall_cells(labels: NDArray[np.int64], depth_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which cells are in regions as wide as a hall."""
    count = int(labels.max()) + 1
    widths_m = 2.0 * ndimage.maximum(depth_m, labels, np.arange(count))
    inside: NDArray[np.bool_] = np.isin(labels, np.flatnonzero(widths_m >= HALL_M))
    return inside


def floor_regions(
    depth_m: NDArray[np.float64], radius_m: float, widest_m: float = DOOR_M, neck: float = NECK
) -> NDArray[np.int64]:
    """Return the region of each cell that the robot fits on, -1 elsewhere.

    `widest_m` is the width of the widest passage that divides, `neck` its largest width as a share
    of the lesser of the two regions' widths.
    """
    depths = np.pad(depth_m, 1)
    columns = depths.shape[1]
    flat = depths.ravel().tolist()
    steps = [row * columns + column for row, column in _BESIDE]
    # Of cells as deep, those near wide floor come first: borders are halfway along a narrow place.
    nearby = ndimage.gaussian_filter(depths, _AROUND_CELLS)
    order = np.lexsort((-nearby.ravel(), -depths.ravel()))
    label = [-1] * len(flat)
    parent: list[int] = []
    widest: list[float] = []

    def root(region: int) -> int:
        while parent[region] != region:
            parent[region] = parent[parent[region]]
            region = parent[region]
        return region

    for cell in order[: np.count_nonzero(depths >= radius_m)].tolist():
        beside = [found for step in steps if (found := label[cell + step]) >= 0]
        if not beside:
            label[cell] = len(parent)
            parent.append(len(parent))
            widest.append(flat[cell])
            continue
        if beside.count(beside[0]) == len(beside):  # most cells: there is nothing to join
            label[cell] = beside[0]
            continue
        # Uphill: regions do not creep along each other's walls.
        known = [cell + step for step in steps if label[cell + step] >= 0]
        label[cell] = label[max(known, key=flat.__getitem__)]
        regions = sorted({root(each) for each in beside})
        for i, region in enumerate(regions):
            for other in regions[i + 1 :]:
                a, b = root(region), root(other)
                lesser = min(widest[a], widest[b])
                if a != b and (flat[cell] > widest_m / 2 or flat[cell] > neck * lesser):
                    wide, narrow = (a, b) if widest[a] >= widest[b] else (b, a)
                    parent[narrow] = wide
    roots = np.array([root(each) if each >= 0 else -1 for each in label], np.int64)
    return roots.reshape(depths.shape)[1:-1, 1:-1]


def hall_parts(
    halls: NDArray[np.bool_], room_m: NDArray[np.float64], radius_m: float, side_m: float
) -> NDArray[np.int64]:
    """Divide halls at necks of any width, and from the gaps and bays that open into them.

    Gaps that meet behind a shelf are one region at first, and divided at their necks then.
    """
    whole = floor_regions(np.where(halls, room_m, 0.0), radius_m, widest_m=math.inf)
    parts = with_corridors(whole, room_m, side_m, in_hall=True)
    off = floor_regions(np.where(parts != whole, room_m, 0.0), radius_m, widest_m=math.inf)
    return np.where(off >= 0, off + (int(parts.max()) + 1), parts)


def with_corridors(
    labels: NDArray[np.int64], depth_m: NDArray[np.float64], side_m: float, *, in_hall: bool = False
) -> NDArray[np.int64]:
    """Give corridors that lead off an open area without a door regions of their own.

    In a hall bays get them, too: what ends there, and opens by a mouth no wider than itself.
    """
    labels = labels.copy()
    for region in np.unique(labels[labels >= 0]).tolist():
        inside = labels == region
        half_m = (_NARROWER_IN_HALL if in_hall else _NARROWER) * float(depth_m[inside].max())
        _part_corridors(labels, region, depth_m, side_m, half_m, in_hall=in_hall)
        # A large circle rounds the corners of a hall, and what lies in them: smaller ones do less.
        while in_hall and (half_m := _FINER * half_m) >= 0.5 * _CORRIDOR_WIDTH_M:
            _part_corridors(labels, region, depth_m, side_m, half_m, in_hall=True)
    return labels


def _part_corridors(
    labels: NDArray[np.int64],
    region: int,
    depth_m: NDArray[np.float64],
    side_m: float,
    half_m: float,
    *,
    in_hall: bool,
) -> None:
    """Give regions of their own to the corridors of a region where no circle of `half_m` fits."""
    unused = int(labels.max()) + 1
    window = around(labels == region)
    labels, depth_m = labels[window], depth_m[window]
    inside = labels == region
    core = inside & (depth_m >= half_m)
    # What circles of that radius cover; a corridor is beyond.
    beyond = inside & (ndimage.distance_transform_edt(~core) * side_m > half_m)
    parts, count = ndimage.label(beyond, np.ones((3, 3)))
    for part in range(1, count + 1):
        cells = parts == part
        width_m = 2.0 * float(depth_m[cells].max())
        area_m2 = np.count_nonzero(cells) * side_m**2
        is_corridor = bool(area_m2 >= CORRIDOR * width_m**2)
        if in_hall and not is_corridor and area_m2 >= _DEEP * width_m**2:
            is_corridor = _mouth_m(cells, inside, labels, side_m) <= _MOUTH * width_m
        if width_m >= _CORRIDOR_WIDTH_M and is_corridor:
            labels[cells] = unused
            unused += 1


def around(cells: NDArray[np.bool_], margin: int = 1) -> tuple[slice, ...]:
    """Return the rows and columns of some cells, and so many more on each side."""
    spans = [np.flatnonzero(cells.any(axis=axis)) for axis in (1, 0)]
    return tuple(slice(max(0, int(s[0]) - margin), int(s[-1]) + margin + 1) for s in spans)


def _mouth_m(
    part: NDArray[np.bool_], hall: NDArray[np.bool_], labels: NDArray[np.int64], side_m: float
) -> float:
    """Return the length of the border of a part to the rest of its hall [m]; inf: it has others."""
    border = ndimage.binary_dilation(part, np.ones((3, 3))) & (labels >= 0) & ~part
    return float(np.count_nonzero(border)) * side_m if hall[border].all() else math.inf
