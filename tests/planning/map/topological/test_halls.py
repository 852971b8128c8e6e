"""Laws of the places of open halls: what is seen from them, and how long ways by them are."""

import itertools
import math
from functools import cache

import numpy as np
import pytest
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import FREE, OCCUPIED, GridMap
from robotctl.planning.map.topological.build import build

RADIUS_M, SIDE_M = 0.2, 0.1
FARTHEST_M = 13.0
"""Of a free cell from a place in a straight free line; 12.4 m were measured."""
DETOUR = 1.4
"""Way by places over the shortest on the cells; 1.37 was measured, 1.08 in the mean."""
HALLS = {
    "empty": (20.0, 15.0, ()),
    "large": (60.0, 40.0, ()),
    "shelves": (
        *(30.0, 20.0),
        [(x, y, x + 1.2, y + 6.0) for x in range(4, 25, 4) for y in (3.0, 11.5)],
    ),
    "rows": (24.0, 18.0, [(0.0, y, 18.0, y + 1.0) for y in (2.0, 5.0, 8.0, 11.0)]),
    "docks": (20.0, 15.0, [(x - 0.1, 12.5, x + 0.1, 15.0) for x in np.arange(2.5, 20.0, 2.5)]),
    "two halls": (
        *(40.0, 25.0),
        [
            *((x, 2.0, x + 1.0, 14.0) for x in range(6, 19, 4)),
            *((37.0, y, 40.0, y + 0.2) for y in (3.0, 6.0, 9.0, 12.0)),
            *((26.0, 0.0, 26.3, 10.0), (26.0, 12.0, 26.3, 25.0)),
        ],
    ),
}
"""Width and depth [m], and boxes that stand in them (low x, low y, high x, high y)."""


def cells_of(name):
    """Return the cells of a hall with a wall around it."""
    width_m, depth_m, boxes = HALLS[name]
    cells = np.full((round(depth_m / SIDE_M) + 2, round(width_m / SIDE_M) + 2), FREE, np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    for box in boxes:
        left, low, right, high = (round(each / SIDE_M) + 1 for each in box)
        cells[low:high, left:right] = OCCUPIED
    return cells


@cache
def built(name):
    grid = GridMap(cells_of(name), SIDE_M, SE2(-3.0, 2.0, 0.4))
    return grid, build(grid, RADIUS_M)


@cache
def at_origin(name):
    return build(GridMap(cells_of(name), SIDE_M), RADIUS_M).map


def room_m(grid):
    """Return how far each cell is from what is not free."""
    away = ndimage.distance_transform_edt(np.pad(grid.free(), 1))[1:-1, 1:-1]
    return (away - 0.5) * grid.resolution_m


def cell_of(grid, item):
    return tuple(grid.cell_of(np.array([[item.x_m, item.y_m]]))[0].tolist())


def distances_m(free, side_m, cells):
    """Return the lengths of shortest paths between cells over free ones, to eight sides."""
    number = np.arange(free.size).reshape(free.shape)
    rows, columns = free.shape
    begins, ends, lengths = [], [], []
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = np.s_[: rows - down, max(0, -right) : columns - max(0, right)]
        there = np.s_[down:, max(0, right) : columns + min(0, right)]
        both = free[here] & free[there]
        begins.append(number[here][both])
        ends.append(number[there][both])
        lengths.append(np.full(len(ends[-1]), math.hypot(down, right) * side_m))
    edges = tuple(map(np.concatenate, (lengths, begins, ends)))
    steps = sparse.csr_matrix((edges[0], edges[1:]), (free.size, free.size))
    at = [row * columns + column for row, column in cells]
    return csgraph.dijkstra(steps, directed=False, indices=at)[:, at]


def seen_from(free, cells, spot):
    """Return which cells are in a straight free line with a spot."""
    off = cells - np.array(spot)
    seen = np.ones(len(cells), np.bool_)
    for share in np.linspace(0.0, 1.0, int(np.abs(off).max()) + 1):
        seen &= free[tuple(np.rint(spot + share * off).astype(int).T)]
    return seen


@pytest.mark.parametrize("name", HALLS)
def test_places_have_room_and_every_free_cell_sees_one(name):
    grid, found = built(name)
    room = room_m(grid)
    cells = np.argwhere(room >= RADIUS_M)[::7]
    nearest_m = np.full(len(cells), np.inf)
    for place in found.map.places:
        spot = cell_of(grid, place)
        assert room[spot] >= 2.0 * RADIUS_M
        away_m = np.hypot(*(cells - np.array(spot)).T) * SIDE_M
        seen = seen_from(grid.free(), cells, spot)
        nearest_m = np.where(seen, np.minimum(nearest_m, away_m), nearest_m)
    assert nearest_m.max() < FARTHEST_M


@pytest.mark.parametrize("name", HALLS)
def test_ways_by_places_are_nearly_the_shortest(name):
    grid, found = built(name)
    items = [*found.map.places, *found.map.passages]
    number = {item.name: index for index, item in enumerate(items)}
    free = room_m(grid) >= RADIUS_M
    lengths_m = distances_m(free, SIDE_M, [cell_of(grid, item) for item in items])
    for a, b in itertools.combinations(found.map.places, 2):
        way = found.map.way(a.name, b.name)
        assert way is not None
        by = [a.name, *(step.passage.name for step in way), b.name]
        driven_m = sum(lengths_m[number[p], number[q]] for p, q in itertools.pairwise(by))
        assert driven_m < DETOUR * lengths_m[number[a.name], number[b.name]]
        # Paths to eight sides are up to 8 % longer than straight lines.
        assert 0.85 * driven_m < way[-1].length_m < driven_m + 0.1


@pytest.mark.parametrize("name", ["shelves", "docks", "rows", "large"])
@pytest.mark.parametrize("change", ["mirrored", "turned"])
def test_a_mirrored_or_turned_hall_has_its_places_mirrored_or_turned(name, change):
    cells = cells_of(name)
    size = np.array(cells.shape)[::-1] * SIDE_M
    straight = at_origin(name)
    other = cells[:, ::-1] if change == "mirrored" else np.rot90(cells)
    places = build(GridMap(np.ascontiguousarray(other), SIDE_M), RADIUS_M).map
    assert len(places.places) == len(straight.places)
    assert len(places.passages) == len(straight.passages)
    for one, all_others in (("places", places.places), ("passages", places.passages)):
        spots = np.array([(each.x_m, each.y_m) for each in all_others])
        for each in getattr(straight, one):
            wanted = (size[0] - each.x_m, each.y_m)
            if (
                change == "turned"
            ):  # counter-clockwise, rows upwards: x becomes the row from the top
                wanted = (each.y_m, size[0] - each.x_m)
            assert np.hypot(*(spots - wanted).T).min() < 0.35, each


def test_the_same_hall_has_the_same_places_twice():
    grid, found = built("shelves")
    again = build(grid, RADIUS_M)
    assert again.map == found.map
    assert np.array_equal(again.labels, found.labels)


def test_aisles_between_shelves_end_in_crossings():
    grid, found = built("shelves")
    at = {
        (x_m, y_m): found.map.places[found.place_at(grid, *centre(grid, x_m, y_m))]
        for x_m in (6.6, 10.6, 14.6, 18.6, 22.6)
        for y_m in (1.5, 6.0, 10.25, 14.5, 18.5)
    }
    assert len({place.name for place in at.values()}) == 25
    ends = [set(passage.between) for passage in found.map.passages]
    for (x_m, y_m), place in at.items():
        assert place.kind == ("corridor" if y_m in {6.0, 14.5} else "junction")
        assert math.dist((place.x_m, place.y_m), centre(grid, x_m, y_m)) < 0.6
        above = at.get((x_m, {1.5: 6.0, 6.0: 10.25, 10.25: 14.5, 14.5: 18.5}.get(y_m)))
        beside = at.get((x_m + 4.0, y_m)) if place.kind == "junction" else None
        for other in (above, beside):
            assert other is None or {place.name, other.name} in ends


def centre(grid, x_m, y_m):
    at = grid.origin @ SE2(x_m + SIDE_M, y_m + SIDE_M)
    return at.x_m, at.y_m


def test_every_dock_is_a_place_of_its_own_those_in_corners_too():
    grid, found = built("docks")
    docks = [found.place_at(grid, *centre(grid, x_m, 13.9)) for x_m in np.arange(1.25, 20.0, 2.5)]
    assert len(set(docks)) == 8
    hall = found.map.places[found.place_at(grid, *centre(grid, 10.0, 6.0))].name
    for number in docks:
        place = found.map.places[number]
        assert {hall, place.name} in [set(passage.between) for passage in found.map.passages]


def test_large_floor_is_divided_evenly():
    _, found = built("large")
    assert [place.area_m2 for place in found.map.places] == pytest.approx([295.0] * 8, rel=0.02)
    assert sorted(len(place.passages) for place in found.map.places) == [2] * 4 + [3] * 4
