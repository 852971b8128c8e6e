"""Places and passages from an occupancy grid.

Free floor is divided where it gets narrow (watershed of the distance from the walls; doors as necks
between wide regions: Thrun, Artificial Intelligence 99(1), 1998). From the widest spots on, cells
join the region beside them; where two regions meet, they become one unless the neck is no wider
than a door and clearly narrower than both. Regions are divided further where corridors meet.
Halls are divided by what stands in them: at necks of any width, so that the gaps between shelves
and the bays along the walls become places. Open floor is halved until it is seen from its middle.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage  # type: ignore[import-untyped]

from robotctl.model.grid_map import GridMap
from robotctl.planning.map.topological.appearance import described
from robotctl.planning.map.topological.graph import (
    Passage,
    PlaceKind,
    TopologicalMap,
    TopologicalPlace,
)
from robotctl.planning.map.topological.junctions import with_junctions
from robotctl.planning.map.topological.open_floor import (
    middle_depth_m,
    middle_of,
    with_open_floor,
)
from robotctl.planning.map.topological.regions import (
    CORRIDOR,
    DOOR_M,
    around,
    floor_regions,
    hall_cells,
    hall_parts,
    with_corridors,
)

LEAST_AREA_M2: Final = 1.0
"""Minimum area of a place; a smaller one joins its neighbour, or is left out."""
FURNITURE_M: Final = 3.5
"""Things that stand free and are no longer than this do not divide a room."""
_HOLE_M: Final = 0.1
"""Maximum gap between parts of one thing: a wall seen from far away has holes."""
_POST_M, _WALL_M = 0.5, 0.4
"""Minimum length and maximum thickness of a wall between two doors."""


@dataclass(frozen=True, slots=True, eq=False)
class Topology:
    """A topological map, and the place of each cell.

    Parameters
    ----------
    map
        Places and passages.
    labels
        (rows, columns): index of the place in the map, -1 for none.
    """

    map: TopologicalMap
    labels: NDArray[np.int64]

    def place_at(self, grid: GridMap, x_m: float, y_m: float) -> int | None:
        """Return the index of the place at a point of the world, None if it is at none."""
        row, column = grid.cell_of(np.array([[x_m, y_m]]))[0].tolist()
        rows, columns = self.labels.shape
        if not (0 <= row < rows and 0 <= column < columns):
            return None
        found = int(self.labels[row, column])
        return found if found >= 0 else None


def build(grid: GridMap, radius_m: float) -> Topology:
    """Divide the free floor of a map into places for a robot of a radius [m].

    Unknown cells count as walls.
    """
    side_m = grid.resolution_m
    floor = _floor(grid)
    room_m, depth_m = _depth_m(floor, side_m), _open_depth_m(floor, side_m)
    labels = floor_regions(depth_m, radius_m)
    if not (labels >= 0).any():
        return Topology(TopologicalMap((), ()), labels)
    halls = hall_cells(labels, depth_m)
    depth_m = np.where(halls, room_m, depth_m)
    labels = with_corridors(np.where(halls, -1, labels), depth_m, side_m)
    parts = hall_parts(halls, room_m, radius_m, side_m)
    labels = np.where(parts >= 0, parts + (int(labels.max()) + 1), labels)
    labels, kinds = with_junctions(labels, depth_m, side_m)
    labels = with_open_floor(labels, depth_m, radius_m, side_m)
    labels = _without_small(labels, depth_m, side_m)
    return _topology(grid, labels, kinds, depth_m, room_m, radius_m)


def open_depth_m(grid: GridMap) -> NDArray[np.float64]:
    """Return the distance of each free cell from walls, without furniture, (rows, columns) [m]."""
    return _open_depth_m(_floor(grid), grid.resolution_m)


def _open_depth_m(floor: NDArray[np.bool_], side_m: float) -> NDArray[np.float64]:
    """Return the same on a floor."""
    return _depth_m(_without_furniture(floor, side_m), side_m)


def _depth_m(free: NDArray[np.bool_], side_m: float) -> NDArray[np.float64]:
    """Return the distance of each free cell from what is not [m]; the edge of a map is a wall."""
    cells: NDArray[np.float64] = ndimage.distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1]
    return (cells - 0.5) * side_m


def _floor(grid: GridMap) -> NDArray[np.bool_]:
    """Return which cells are free and not walled in, like the inside of a table's outline."""
    free: NDArray[np.bool_] = grid.free()
    floors, _ = ndimage.label(free)
    sizes = np.bincount(floors.ravel())
    large: NDArray[np.bool_] = sizes[floors] * grid.resolution_m**2 >= FURNITURE_M**2
    return free & large


def _without_furniture(floor: NDArray[np.bool_], side_m: float) -> NDArray[np.bool_]:
    """Return the floor as it would be without small things that stand free."""
    free = floor.copy()
    away_m = ndimage.distance_transform_edt(free) * side_m
    things, _ = ndimage.label(away_m <= 0.5 * _HOLE_M, np.ones((3, 3)))
    things[free] = 0
    most = FURNITURE_M / side_m
    edge = np.zeros_like(free)
    edge[[0, -1], :] = edge[:, [0, -1]] = True
    at_edge = set(np.unique(things[edge]).tolist())
    depth_m = ndimage.distance_transform_edt(~free) * side_m
    for number, (rows, columns) in enumerate(ndimage.find_objects(things), start=1):
        longest = max(rows.stop - rows.start, columns.stop - columns.start)
        thing = things[rows, columns] == number
        is_thin = float(depth_m[rows, columns][thing].max()) < _WALL_M / 2
        is_wall = is_thin and longest * side_m > _POST_M
        if number not in at_edge and longest <= most and not is_wall:
            free[rows, columns] |= thing
    return free


def _without_small(
    labels: NDArray[np.int64], depth_m: NDArray[np.float64], side_m: float
) -> NDArray[np.int64]:
    """Join small regions to the one beside them that is reached by the widest passage."""
    labels = labels.copy()
    for region in np.unique(labels[labels >= 0]).tolist():
        inside = labels == region
        if np.count_nonzero(inside) * side_m**2 >= LEAST_AREA_M2:
            continue
        border = ndimage.binary_dilation(inside, np.ones((3, 3))) & ~inside & (labels >= 0)
        labels[inside] = -1
        if border.any():
            best = np.argmax(np.where(border, depth_m, -1.0))
            labels[inside] = labels.ravel()[best]
    return labels


def _topology(
    grid: GridMap,
    labels: NDArray[np.int64],
    kinds: Mapping[int, PlaceKind],
    depth_m: NDArray[np.float64],
    room_m: NDArray[np.float64],
    radius_m: float,
) -> Topology:
    """Return places, largest first, and passages of regions; `room_m` is around each cell.

    Regions without a kind get it by their shape.
    """
    regions, sizes = np.unique(labels[labels >= 0], return_counts=True)
    regions = regions[np.argsort(-sizes, kind="stable")]
    rank = np.full(labels.max() + 1, -1)
    rank[regions] = np.arange(len(regions))
    labels = np.where(labels >= 0, rank[labels], -1)
    places = []
    for number, region in enumerate(regions.tolist()):
        inside = labels == number
        depths_m = middle_depth_m(inside, depth_m, radius_m, grid.resolution_m)
        middle = _middle(depths_m, room_m, radius_m, grid.resolution_m)
        places.append(_place(grid, inside, kinds.get(region), depths_m, middle, number))
    passages = _passages(grid, labels, depth_m, places)
    numbers = {place.name: number for number, place in enumerate(places)}
    whole = [described(grid, labels, room_m, each, passages, numbers) for each in places]
    return Topology(TopologicalMap(tuple(whole), tuple(passages)), labels)


def _middle(
    depths_m: NDArray[np.float64], room_m: NDArray[np.float64], radius_m: float, side_m: float
) -> NDArray[np.int64]:
    """Return the middle of a place: its widest spot where a robot has room beside what stands."""
    for least_m in (2.0 * radius_m, radius_m):
        spots_m = np.where(room_m >= least_m, depths_m, 0.0)
        if spots_m.any():
            return middle_of(spots_m, side_m)
    return middle_of(depths_m, side_m)


def _place(
    grid: GridMap,
    inside: NDArray[np.bool_],
    kind: PlaceKind | None,
    depths_m: NDArray[np.float64],
    middle: NDArray[np.int64],
    number: int,
) -> TopologicalPlace:
    """Return a place, without its passages and what it looks like."""
    area_m2 = float(np.count_nonzero(inside)) * grid.resolution_m**2
    width_m = 2.0 * float(depths_m.max())
    if kind is None:
        kind = "corridor" if area_m2 >= CORRIDOR * width_m**2 else "room"
    x_m, y_m = grid.centre_of(middle[None])[0].tolist()
    name = f"{kind} {number + 1}"
    return TopologicalPlace(name, kind, (), area_m2, width_m, x_m=x_m, y_m=y_m)


def _passages(
    grid: GridMap,
    labels: NDArray[np.int64],
    depth_m: NDArray[np.float64],
    places: list[TopologicalPlace],
) -> list[Passage]:
    """Return a passage for each connected border between two places."""
    meetings: dict[tuple[int, int], NDArray[np.bool_]] = {}
    for row, column in ((0, 1), (1, 0), (1, 1), (1, -1)):
        shifted = np.full_like(labels, -1)
        begin, end = max(0, -column), labels.shape[1] - max(0, column)
        shifted[: labels.shape[0] - row, begin:end] = labels[row:, begin + column : end + column]
        border = (labels >= 0) & (shifted >= 0) & (labels != shifted)
        for cell in np.argwhere(border):
            a, b = sorted((int(labels[tuple(cell)]), int(shifted[tuple(cell)])))
            meetings.setdefault((a, b), np.zeros(labels.shape, np.bool_))[tuple(cell)] = True
    result: list[Passage] = []
    for (a, b), border in sorted(meetings.items(), key=lambda each: each[0]):
        # Borders jump from one side to the other by a cell.
        parts, count = ndimage.label(ndimage.binary_dilation(border, np.ones((3, 3))))
        for part in range(1, count + 1):
            room_m = _room_m(border & (parts == part), labels, (a, b), depth_m, grid.resolution_m)
            if not room_m.any():  # two places of an open floor touch in a corner
                continue
            cell = middle_of(room_m, grid.resolution_m)
            x_m, y_m = grid.centre_of(cell[None])[0].tolist()
            length_m = sum(_apart_m(places[end], x_m, y_m) for end in (a, b))
            name, width_m = f"passage {len(result) + 1}", 2.0 * float(room_m.max())
            between = places[a].name, places[b].name
            result.append(Passage(name, between, width_m, length_m, x_m, y_m))
    return result


def _room_m(
    border: NDArray[np.bool_],
    labels: NDArray[np.int64],
    between: tuple[int, int],
    depth_m: NDArray[np.float64],
    side_m: float,
) -> NDArray[np.float64]:
    """Return how far the cells of a border are from walls and other places [m], 0 elsewhere."""
    window = around(border, int(depth_m[border].max() / side_m) + 3)
    others = (labels[window] >= 0) & ~np.isin(labels[window], between)
    away = ndimage.distance_transform_edt(~np.pad(others, 1, constant_values=True))[1:-1, 1:-1]
    room_m = np.zeros(labels.shape)
    room_m[window] = np.minimum(depth_m[window], np.maximum(away - 1.5, 0.0) * side_m)
    # A door stays a passage where a third place is beside it.
    is_door = depth_m[border].max() <= 0.5 * DOOR_M
    return np.where(border, depth_m if is_door else room_m, 0.0)


def _apart_m(place: TopologicalPlace, x_m: float, y_m: float) -> float:
    return math.hypot(place.x_m - x_m, place.y_m - y_m)
